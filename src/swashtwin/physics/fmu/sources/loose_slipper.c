/* Part of swashtwin. Copyright the swashtwin developers; SPDX-License-Identifier: BSD-3-Clause */

/* A piston that rattles in the worn ball joint of its slipper.

   Its displacement u along the shaft, relative to the slipper, and the pressure of its chamber:

     m u'' = -A (p - p_case) + m R tan(gamma) omega^2 cos(phi) - friction + stop forces
     p' = B(p) / V [Q_suction - Q_discharge - G (p - p_case) - V' + A u']

   The other chambers and the outlet line are those of a tight joint. The result is the difference
   to the same joint without clearance. */

#include "pump_twin.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define START_ANGLE (1.5 * PI)   /* of the loose piston: under pressure, so that it is pressed on */
#define MAX_REVOLUTIONS 20
#define MAX_REPEAT_ERROR 1e-6
#define STEPS_PER_PULSE 100
#define MIN_STEPS_PER_TURN 16384
#define FRICTION 20.0            /* of the piston in its bore [N] */
#define MIN_SLIDING_SPEED 0.01   /* below which friction fades [m/s] */
#define PRESSURE_ITERATIONS 80
#define PRESSURE_TOLERANCE 1e-3  /* [Pa] */

typedef struct {
    ChamberAngle chamber;
    double growth;       /* of the volume [m^3/s] */
    double leakage;      /* of all gaps [m^3/(s Pa)] */
    double outlet;       /* pressure of the outlet line [Pa] */
    double velocity;     /* of a tight joint [m/s] */
    double acceleration; /* of a tight joint [m/s^2] */
} LooseAngle;

typedef struct {
    double *velocity; /* u' [m/s] */
    double *pressure; /* of the chamber [Pa] */
} Motion;

/* Return the chamber's pressure after a step of backward Euler. `displaced` is the flow [m^3/s]
   that the loose piston displaces. */
static double next_pressure(double step, double displaced, const LooseAngle *here, double previous)
{
    double air_pressure = fmax(previous, AIR_FLOOR);
    double softness = OIL_SOFTNESS + FREE_AIR / (air_pressure * air_pressure);
    double compliance = step / (here->chamber.volume * softness);
    double pressure = previous;
    double damping = 1.0;
    double previous_change = 0.0;
    for (int iteration = 0; iteration < PRESSURE_ITERATIONS; iteration++) {
        double falling;
        double rising;
        double inward = orifice_flow(here->chamber.suction, SUCTION_PRESSURE - pressure, &falling);
        double outward = orifice_flow(here->chamber.discharge, pressure - here->outlet, &rising);
        double leak = here->leakage * (pressure - CASE_PRESSURE);
        double flow = inward - outward - leak - here->growth + displaced;
        double slope = 1 + compliance * (falling + rising + here->leakage);
        double change = (previous + compliance * flow - pressure) / slope;

        /* A change of the other sign has passed the solution: the step is halved, then regrows. */
        damping = change * previous_change < 0 ? 0.5 * damping : fmin(1.0, 1.5 * damping);
        previous_change = change;
        pressure = fmax(pressure + damping * change, PRESSURE_FLOOR);
        if (fabs(change) < PRESSURE_TOLERANCE) {
            break;
        }
    }
    return pressure;
}

/* Fill the motion over a revolution from `state` (u, u', p), which becomes that at its end. */
static void rattle(const LooseAngle *over_angle, int steps, double step, double clearance,
                   double state[3], Motion *motion)
{
    double stop = PISTON_SLIPPER_MASS * (PI / FAULT_PULSE) * (PI / FAULT_PULSE);
    double damper = 2 * FAULT_DAMPING_RATIO * sqrt(stop * PISTON_SLIPPER_MASS);
    double u = state[0];
    double v = state[1];
    double p = state[2];
    for (int i = 0; i < steps; i++) {
        motion->velocity[i] = v;
        motion->pressure[i] = p;

        const LooseAngle *here = over_angle + i;
        double force =
            -PISTON_AREA * (p - CASE_PRESSURE) - PISTON_SLIPPER_MASS * here->acceleration;
        if (u < 0) {
            force += fmax(0.0, -stop * u - damper * v);
        }
        if (u > clearance) {
            force -= fmax(0.0, stop * (u - clearance) + damper * v);
        }
        double sliding = (here->velocity + v) / MIN_SLIDING_SPEED;
        force -= FRICTION * fmax(-1.0, fmin(1.0, sliding));

        /* Velocity before displacement: in this order a stop gains no energy. */
        v += step * force / PISTON_SLIPPER_MASS;
        u += step * v;
        p = next_pressure(step, PISTON_AREA * v, over_angle + (i + 1) % steps, p);
    }
    state[0] = u;
    state[1] = v;
    state[2] = p;
}

/* Fill the revolution of the motion that repeats. */
static bool settle(const OperatingPoint *point, const LooseAngle *over_angle, int steps,
                   double clearance, Motion *motion, char *message)
{
    double stop = PISTON_SLIPPER_MASS * (PI / FAULT_PULSE) * (PI / FAULT_PULSE);
    double pressed = PISTON_AREA * (point->discharge_pressure - CASE_PRESSURE) / stop;
    double scale[3] = {pressed + clearance, (pressed + clearance) * point->speed,
                       point->discharge_pressure};
    double state[3] = {-pressed, 0.0, point->discharge_pressure};
    double step = 2 * PI / point->speed / steps;
    for (int revolution = 0; revolution < MAX_REVOLUTIONS; revolution++) {
        double start[3] = {state[0], state[1], state[2]};
        rattle(over_angle, steps, step, clearance, state, motion);
        double change = 0.0;
        for (int i = 0; i < 3; i++) {
            change = fmax(change, fabs(state[i] - start[i]) / scale[i]);
        }
        if (change < MAX_REPEAT_ERROR) {
            return true;
        }
    }
    snprintf(message, MESSAGE_SIZE,
             "The loose slipper's motion does not repeat within %d revolutions, so it has no order "
             "lines: lower " FAULT_SEVERITY_NAME ".",
             MAX_REVOLUTIONS);
    return false;
}

/* Fill what holds at each angle of the loose piston. */
static void fill_angles(const OperatingPoint *point, const Pressures *tight, int steps,
                        LooseAngle *over_angle)
{
    double lift = PITCH_RADIUS * tan(SWASH_ANGLE);
    double clearance_cubed = PISTON_CLEARANCE * PISTON_CLEARANCE * PISTON_CLEARANCE;
    double ahead = 2 * PI * FAULT_PISTON / PISTONS;
    for (int i = 0; i < steps; i++) {
        double angle = START_ANGLE + 2 * PI * i / steps;
        LooseAngle *here = over_angle + i;
        chamber_at(point, false, angle, &here->chamber);
        here->growth = here->chamber.growth * point->speed;
        here->leakage = here->chamber.leakage + here->chamber.piston_leakage * clearance_cubed;
        here->outlet = interpolate_periodic(tight->line, 1, tight->steps, 2 * PI / tight->steps,
                                            angle - ahead);
        here->velocity = -lift * point->speed * sin(angle);
        here->acceleration = -lift * point->speed * point->speed * cos(angle);
    }
}

/* Add a force over the angles, which acts through its sum and its moments. */
static bool add_force(const double *force, int steps, double first_angle,
                      const double shares[DOFS][3], int orders, Complex *lines)
{
    double *loads = malloc(sizeof(double) * 3 * (size_t)steps);
    if (loads == NULL) {
        return false;
    }
    for (int i = 0; i < steps; i++) {
        double angle = first_angle + 2 * PI * i / steps;
        loads[i] = force[i];
        loads[steps + i] = PITCH_RADIUS * force[i] * cos(angle);
        loads[2 * (size_t)steps + i] = PITCH_RADIUS * force[i] * sin(angle);
    }
    double ahead = 2 * PI * FAULT_PISTON / PISTONS;
    bool done = add_lines_of_loads(loads, steps, first_angle, ahead, shares, orders, lines);
    free(loads);
    return done;
}

bool add_loose_slipper_lines(const OperatingPoint *point, int orders, Complex *force,
                             char *message)
{
    double period = 2 * PI / point->speed;
    if (FAULT_PULSE < period / 1e4 || FAULT_PULSE > period) {
        snprintf(message, MESSAGE_SIZE,
                 "The impact of %.3g s of the loose slipper must last between a ten-thousandth of "
                 "a revolution and a revolution (%.3g s): change speed.",
                 FAULT_PULSE, period);
        return false;
    }
    Pressures tight_pressures;
    if (!solve_chambers(point, false, MIN_STEPS, &tight_pressures, message)) {
        return false;
    }

    double wanted = ceil(STEPS_PER_PULSE * period / FAULT_PULSE);
    int steps = power_of_two(wanted > MIN_STEPS_PER_TURN ? (int)wanted : MIN_STEPS_PER_TURN);
    size_t size = (size_t)steps;
    LooseAngle *over_angle = malloc(sizeof(LooseAngle) * size);
    double *memory = malloc(sizeof(double) * 6 * size);
    bool done = over_angle != NULL && memory != NULL;
    if (!done) {
        snprintf(message, MESSAGE_SIZE, "Out of memory.");
    } else {
        Motion tight = {memory, memory + size};
        Motion loose = {memory + 2 * size, memory + 3 * size};
        double *inertia = memory + 4 * size;
        double *pressing = memory + 5 * size;
        fill_angles(point, &tight_pressures, steps, over_angle);
        done = settle(point, over_angle, steps, 0.0, &tight, message) &&
               settle(point, over_angle, steps, point->severity, &loose, message);

        /* An acceleration is the difference of two steps, and belongs to the angle between. */
        double step = period / steps;
        for (int i = 0; done && i < steps; i++) {
            int next = (i + 1) % steps;
            double change = loose.velocity[next] - loose.velocity[i];
            double tight_change = tight.velocity[next] - tight.velocity[i];
            inertia[i] = PISTON_SLIPPER_MASS * (change - tight_change) / step;
            pressing[i] = PISTON_AREA * (loose.pressure[i] - tight.pressure[i]);
        }
        if (done) {
            done = add_force(inertia, steps, START_ANGLE + PI / steps, SLIPPER_SHARES, orders,
                             force) &&
                   add_force(pressing, steps, START_ANGLE, PRESSURE_SHARES, orders, force);
            if (!done) {
                snprintf(message, MESSAGE_SIZE, "Out of memory.");
            }
        }
    }
    free(memory);
    free(over_angle);
    free_pressures(&tight_pressures);
    return done;
}
