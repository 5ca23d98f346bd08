/* Part of swashtwin. Copyright the swashtwin developers; SPDX-License-Identifier: BSD-3-Clause */

/* Pressure of every chamber over the shaft angle.

   Each chamber follows dp/dtheta = B / (omega V) [Q_suction - Q_discharge - G (p - p_case)]
   - B / V dV/dtheta, and the outlet line follows the sum of the flows into it less that of its
   relief valve. Integrated by the backward differentiation formula of second order (BDF2) in equal
   steps of the shaft angle, for two revolutions, of which the second is used.

   The order of the arithmetic is that of swashtwin's Python: Newton's method then takes the same
   iterations. With another order it may stop one earlier or later, which changes a pressure by up
   to 1 Pa. */

#include "pump_twin.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define RATE_WEIGHT (2.0 / 3.0) /* of the rate in BDF2 */
#define REVOLUTIONS 2

typedef struct {
    double suction;    /* see ChamberAngle */
    double discharge;
    double compliance; /* growth of the pressure in a step per flow [Pa s/m^3] */
    double leakage;    /* [m^3/(s Pa)] */
    double constant;   /* pressure at the end of the step without flow through the ports [Pa] */
} ChamberStep;

typedef struct {
    double compliance; /* see ChamberStep */
    double relief;     /* flow of the relief valve over the pressure above cracking [m^3/(s Pa)] */
    double cracking;   /* that pressure [Pa] */
    double history;    /* pressure at the end of the step without any flow [Pa] */
} OutletLine;

/* Return the steps of a revolution, rounded up to a multiple of the number of pistons. */
int chamber_steps(int min_steps)
{
    return (min_steps + PISTONS - 1) / PISTONS * PISTONS;
}

void free_pressures(Pressures *pressures)
{
    free(pressures->chamber);
    free(pressures->line);
    pressures->chamber = NULL;
    pressures->line = NULL;
}

/* Return the flow through an orifice under a pressure difference, and fill its derivative. The
   square root turns linear below SMOOTHING. */
double orifice_flow(double opening, double difference, double *slope)
{
    if (opening == 0.0) {
        *slope = 0.0;
        return 0.0;
    }
    double root = fabs(difference) + SMOOTHING;
    double ratio = opening / sqrt(root);
    *slope = ratio * (1 - 0.5 * fabs(difference) / root);
    return ratio * difference;
}

static double limited(double value, double low, double high)
{
    return value < low ? low : (value > high ? high : value);
}

/* Return the area by which a bore opens onto a port: a kidney, ahead of which lies a triangular
   relief groove. */
static double port_opening(double angle, double opens, double closes, double advance,
                           double groove_factor)
{
    double length = closes - opens + advance;
    double turned =
        positive_remainder(angle - opens + advance + GROOVE_ANGLE, 2 * PI) - GROOVE_ANGLE;
    double ramp = limited(fmin(turned, length - turned) / PORT_RAMP, 0, 1);
    double kidney = PORT_AREA * ramp;
    if (turned >= length / 2) {
        return kidney;
    }
    double along = PITCH_RADIUS * limited(turned + GROOVE_ANGLE, 0, GROOVE_ANGLE);
    double depth = along * tan(GROOVE_SLOPE);
    return fmax(kidney, groove_factor * (depth * depth) * tan(GROOVE_FLANK / 2));
}

/* Return the conductance from one chamber across the valve plate's sealing lands. */
static double valve_plate_leakage(double film)
{
    return pow(film, 3) / (12 * VISCOSITY) * (2 * PI / PISTONS) * VALVE_PLATE_LANDS;
}

/* Fill what holds for a chamber whose piston stands at a shaft angle [rad]. The leakage of a
   slipper over a recess is added by solve_chambers. */
void chamber_at(const OperatingPoint *point, bool with_fault, double angle, ChamberAngle *chamber)
{
    double advance = 0.0;
    double groove_factor = 1.0;
    double scratch = 0.0;
    double film = VALVE_PLATE_FILM;
    if (with_fault && FAULT == GROOVE_EROSION) {
        advance = point->severity;
        groove_factor = FAULT_AREA_FACTOR;
    }
    if (with_fault && FAULT == DAM_SCRATCH) {
        double from_bottom = (positive_remainder(angle, 2 * PI) - PI) / FAULT_WIDTH;
        scratch = point->severity * exp(-0.5 * from_bottom * from_bottom);
    }
    if (with_fault && FAULT == VALVE_PLATE_WEAR) {
        film += point->severity;
    }

    double lift = PITCH_RADIUS * tan(SWASH_ANGLE);
    double stroke_share = 1 - cos(angle);
    double suction = port_opening(angle, SUCTION_OPEN, SUCTION_CLOSE, advance, groove_factor);
    double discharge =
        port_opening(angle, DISCHARGE_OPEN, DISCHARGE_CLOSE, advance, groove_factor) + scratch;
    chamber->suction = ORIFICE * suction;
    chamber->discharge = ORIFICE * discharge;
    chamber->volume = DEAD_VOLUME + PISTON_AREA * lift * stroke_share;
    chamber->growth = PISTON_AREA * lift * sin(angle);
    chamber->leakage = SLIPPER_LEAKAGE + valve_plate_leakage(film);
    chamber->piston_leakage = PISTON_LEAKAGE / (PISTON_GUIDE_LENGTH - lift * stroke_share);
}

/* Add the recess that slippers sink into, if its films cannot pull: a volume, and the leakage of
   the slippers over it, which do not seal. */
static void add_recess(const OperatingPoint *point, int steps, ChamberAngle *over_angle)
{
    double max_height = 0.0;
    for (int i = 0; i < steps; i++) {
        double slope;
        max_height = fmax(max_height, recess_height(point, 2 * PI * i / steps, &slope));
    }

    /* A sharp-edged damping hole and the land of the lifted slipper are in series. */
    double film = SLIPPER_FILM + max_height;
    double land = PI * pow(film, 3) / (6 * VISCOSITY * SLIPPER_LOG_RATIO);
    double hole = SLIPPER_HOLE_AREA * sqrt(2 / (OIL_DENSITY * point->discharge_pressure));
    double added = fmax(0.0, hole * land / (hole + land) - SLIPPER_LEAKAGE);
    for (int i = 0; i < steps; i++) {
        double slope;
        double height = recess_height(point, 2 * PI * i / steps, &slope);
        double slipper_leakage = SLIPPER_LEAKAGE + FAULT_LEAKAGE * added * height / max_height;
        over_angle[i].volume += PISTON_AREA * height / cos(SWASH_ANGLE);
        over_angle[i].growth += PISTON_AREA * slope / cos(SWASH_ANGLE);
        over_angle[i].leakage = slipper_leakage + valve_plate_leakage(VALVE_PLATE_FILM);
    }
}

/* Solve one step into `pressure`; return the outlet line's pressure, NaN without convergence.

   Newton's method. Its matrix is an arrow, because each chamber meets only the line: the rows are
   eliminated one by one, which leaves one equation for the change of the line's pressure. */
static double newton(const ChamberStep *step, const OutletLine *outlet, double *pressure,
                     double line)
{
    double residual[PISTONS];
    double diagonal[PISTONS];
    double through[PISTONS];
    double damping[PISTONS];
    double previous_change[PISTONS];
    for (int j = 0; j < PISTONS; j++) {
        damping[j] = 1.0;
        previous_change[j] = 0.0;
    }

    for (int iteration = 0; iteration < NEWTON_ITERATIONS; iteration++) {
        double flow_sum = 0.0;
        double slope_sum = 0.0;
        double pushed = 0.0;
        double answered = 0.0;
        for (int j = 0; j < PISTONS; j++) {
            double slope_in;
            double slope_out;
            double flow_in =
                orifice_flow(step[j].suction, SUCTION_PRESSURE - pressure[j], &slope_in);
            double flow_out = orifice_flow(step[j].discharge, pressure[j] - line, &slope_out);
            double flow = flow_in - flow_out - step[j].leakage * pressure[j];
            residual[j] = pressure[j] - step[j].constant - step[j].compliance * flow;
            diagonal[j] = 1 + step[j].compliance * (slope_in + slope_out + step[j].leakage);
            through[j] = -step[j].compliance * slope_out;
            double from_chamber = -outlet->compliance * slope_out / diagonal[j];
            flow_sum += flow_out;
            slope_sum += slope_out;
            pushed += from_chamber * residual[j];
            answered += from_chamber * through[j];
        }

        double excess = line - outlet->cracking;
        double outflow = outlet->relief * fmax(excess, 0.0);
        double outflow_slope = excess > 0 ? outlet->relief : 0.0;
        double line_residual = line - outlet->history - outlet->compliance * (flow_sum - outflow);
        double line_diagonal = 1 + outlet->compliance * (slope_sum + outflow_slope);
        double line_change = (pushed - line_residual) / (line_diagonal - answered);

        /* A change of the other sign has passed the solution: its step is halved, then regrows. */
        double largest_change = 0.0;
        double min_damping = 1.0;
        for (int j = 0; j < PISTONS; j++) {
            double change = (-residual[j] - through[j] * line_change) / diagonal[j];
            if (change * previous_change[j] < 0) {
                damping[j] = 0.5 * damping[j];
            } else {
                damping[j] = fmin(1.0, 1.5 * damping[j]);
            }
            previous_change[j] = change;
            double updated = fmax(pressure[j] + damping[j] * change, PRESSURE_FLOOR);
            largest_change = fmax(largest_change, fabs(updated - pressure[j]));
            min_damping = fmin(min_damping, damping[j]);
            pressure[j] = updated;
        }
        line += min_damping * line_change;
        if (fmax(largest_change / min_damping, fabs(line_change)) < NEWTON_TOLERANCE) {
            return line;
        }
    }
    return NAN;
}

/* Integrate the pressures; return the step that failed, or 0. */
static int march(const OperatingPoint *point, const ChamberAngle *over_angle,
                 const double *clearance_cubed, const double *added_leakage, double step_time,
                 OutletLine *outlet, Pressures *pressures)
{
    int steps = pressures->steps;
    int stride = steps / PISTONS;
    double pressure[PISTONS];
    double earlier[PISTONS];
    ChamberStep step[PISTONS];

    /* Chambers whose pistons go in start at the discharge pressure, the others at the suction's.
       The pump has rested before the start. */
    for (int j = 0; j < PISTONS; j++) {
        bool rising = sin(2 * PI * j / PISTONS) < -1e-9;
        pressure[j] = rising ? point->discharge_pressure : SUCTION_PRESSURE;
        earlier[j] = pressure[j];
    }
    double line = point->discharge_pressure;
    double earlier_line = line;

    for (int index = 1; index <= REVOLUTIONS * steps; index++) {
        int end = (index - 1) % steps;
        for (int j = 0; j < PISTONS; j++) {
            const ChamberAngle *here = over_angle + (end + 1 + j * stride) % steps;
            double history = (4 * pressure[j] - earlier[j]) / 3;
            double expected = 2 * pressure[j] - earlier[j];
            earlier[j] = pressure[j];
            pressure[j] = fmax(expected, PRESSURE_FLOOR);

            /* Compressibility of oil and of its free air, which is isothermal. */
            double air_pressure = fmax(expected, AIR_FLOOR);
            double softness = OIL_SOFTNESS + FREE_AIR / (air_pressure * air_pressure);
            double compliance = RATE_WEIGHT * (step_time / here->volume) / softness;
            double leakage =
                here->leakage + here->piston_leakage * clearance_cubed[j] + added_leakage[j];
            step[j].suction = here->suction;
            step[j].discharge = here->discharge;
            step[j].compliance = compliance;
            step[j].leakage = leakage;
            double growth = here->growth * point->speed; /* [m^3/s] */
            step[j].constant = history + compliance * (leakage * CASE_PRESSURE - growth);
        }

        outlet->history = (4 * line - earlier_line) / 3;
        earlier_line = line;
        line = newton(step, outlet, pressure, line);
        if (isnan(line)) {
            return index;
        }
        for (int j = 0; j < PISTONS; j++) {
            pressures->chamber[(size_t)end * PISTONS + j] = pressure[j];
        }
        pressures->line[end] = line;
    }
    return 0;
}

bool solve_chambers(const OperatingPoint *point, bool with_fault, int min_steps,
                    Pressures *pressures, char *message)
{
    int steps = chamber_steps(min_steps);
    double step_time = 2 * PI / steps / point->speed;
    double shaft_frequency = point->speed / (2 * PI);

    ChamberAngle *over_angle = malloc(sizeof(ChamberAngle) * (size_t)steps);
    pressures->steps = steps;
    pressures->chamber = malloc(sizeof(double) * PISTONS * (size_t)steps);
    pressures->line = malloc(sizeof(double) * (size_t)steps);
    if (over_angle == NULL || pressures->chamber == NULL || pressures->line == NULL) {
        free(over_angle);
        free_pressures(pressures);
        snprintf(message, MESSAGE_SIZE, "Out of memory.");
        return false;
    }

    for (int i = 0; i < steps; i++) {
        chamber_at(point, with_fault, 2 * PI * i / steps, over_angle + i);
    }
    if (with_fault && FAULT == RECESS && !RECESS_STRAINS_FILMS && recess_depth(point) > 0) {
        add_recess(point, steps, over_angle);
    }

    double clearance_cubed[PISTONS];
    double added_leakage[PISTONS];
    for (int j = 0; j < PISTONS; j++) {
        double clearance = PISTON_CLEARANCE;
        if (with_fault && FAULT == PISTON_WEAR && j == FAULT_PISTON) {
            clearance += point->severity;
        }
        clearance_cubed[j] = pow(clearance, 3);
        bool is_scratched = with_fault && FAULT == SEALING_LAND_SCRATCH && j == FAULT_PISTON;
        added_leakage[j] = is_scratched ? point->severity : 0.0;
    }

    /* At full override the relief valve passes all that the pump displaces. */
    OutletLine outlet;
    outlet.compliance = RATE_WEIGHT * (step_time * BULK_MODULUS / LINE_VOLUME);
    outlet.relief = DISPLACEMENT * shaft_frequency / RELIEF_OVERRIDE;
    outlet.cracking = point->discharge_pressure - CRACKING_SHARE * RELIEF_OVERRIDE;
    outlet.history = point->discharge_pressure;
    int failed = march(point, over_angle, clearance_cubed, added_leakage, step_time, &outlet,
                       pressures);
    free(over_angle);
    if (failed) {
        snprintf(message, MESSAGE_SIZE,
                 "Chamber pressures do not converge at %.4g rad/s and %.4g Pa: change speed, or lower "
                 "discharge_pressure" OR_LOWER_SEVERITY ".",
                 point->speed, point->discharge_pressure);
        free_pressures(pressures);
        return false;
    }

    double excess_sum = 0.0;
    for (int i = 0; i < steps; i++) {
        excess_sum += fmax(pressures->line[i] - outlet.cracking, 0.0);
    }
    if (excess_sum <= 0) {
        snprintf(message, MESSAGE_SIZE,
                 "The pump leaks all it displaces at %.4g rad/s and cannot hold %.4g Pa: raise "
                 "speed, or lower discharge_pressure" OR_LOWER_SEVERITY ".",
                 point->speed, point->discharge_pressure);
        free_pressures(pressures);
        return false;
    }
    return true;
}
