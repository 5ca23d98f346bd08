/* Part of swashtwin. Copyright the swashtwin developers; SPDX-License-Identifier: BSD-3-Clause */

/* Steady state of the pump: forces, motion of the 13 degrees of freedom, and sensors' readings. */

#include "pump_twin.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define NEGLIGIBLE_SHARE 1e-7 /* line over the largest one below which it is rounding */
#define POINTS_PER_PERIOD 32  /* of `revolution`, in the period of the highest order */
#define TURNING_ITERATIONS 200
#define TURNING_TOLERANCE 1e-10   /* change of the lines, relative to the largest */
#define TURNING_ROUNDING 1e-8     /* the same, up to which a stalled iteration has converged */
#define TAPS 8                    /* points of the interpolation in `revolution` */

/* Denominators of Lagrange's interpolation: products of (tap - other), inverted. */
static const double LAGRANGE_FACTOR[TAPS] = {-1.0 / 5040, 1.0 / 720,  -1.0 / 240, 1.0 / 144,
                                             -1.0 / 144,  1.0 / 240, -1.0 / 720, 1.0 / 5040};

static Complex multiply(Complex a, Complex b)
{
    Complex product = {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
    return product;
}

static Complex divide(Complex a, Complex b)
{
    double size = b.re * b.re + b.im * b.im;
    Complex ratio = {(a.re * b.re + a.im * b.im) / size, (a.im * b.re - a.re * b.im) / size};
    return ratio;
}

static double magnitude(Complex z)
{
    return hypot(z.re, z.im);
}

Twin *twin_create(void)
{
    Twin *twin = calloc(1, sizeof(Twin));
    bool done = twin != NULL;
    for (int sensor = 0; done && sensor < SENSORS; sensor++) {
        int max_grid = power_of_two(POINTS_PER_PERIOD * (MAX_ORDERS + 1));
        twin->line[sensor] = calloc(MAX_ORDERS + 1, sizeof(Complex));
        twin->revolution[sensor] = calloc((size_t)max_grid, sizeof(double));
        done = twin->line[sensor] != NULL && twin->revolution[sensor] != NULL;
    }
    if (!done) {
        twin_free(twin);
        return NULL;
    }
    twin->grid = TAPS;
    return twin;
}

void twin_free(Twin *twin)
{
    if (twin == NULL) {
        return;
    }
    for (int sensor = 0; sensor < SENSORS; sensor++) {
        free(twin->line[sensor]);
        free(twin->revolution[sensor]);
    }
    free(twin);
}

double twin_line_amplitude(const Twin *twin, int sensor, int order)
{
    return order <= twin->orders ? magnitude(twin->line[sensor][order]) : 0.0;
}

/* Lagrange's interpolation: with POINTS_PER_PERIOD its error is 3e-9 of the highest line. */
void twin_acceleration(const Twin *twin, double angle, double acceleration[SENSORS])
{
    double position = positive_remainder(angle, 2 * PI) * twin->grid / (2 * PI);
    int index = (int)position;
    double share = position - index;

    double weight[TAPS];
    for (int tap = 0; tap < TAPS; tap++) {
        double product = LAGRANGE_FACTOR[tap];
        for (int other = 0; other < TAPS; other++) {
            if (other != tap) {
                product *= share + TAPS / 2 - 1 - other;
            }
        }
        weight[tap] = product;
    }
    for (int sensor = 0; sensor < SENSORS; sensor++) {
        double sum = 0.0;
        for (int tap = 0; tap < TAPS; tap++) {
            int point = (index + tap - (TAPS / 2 - 1) + twin->grid) & (twin->grid - 1);
            sum += weight[tap] * twin->revolution[sensor][point];
        }
        acceleration[sensor] = sum;
    }
}

/* Add the lines of the chamber pressures' forces, and of the rotor's unbalance. */
static bool add_pressure_lines(const OperatingPoint *point, int orders, Complex *force,
                               char *message)
{
    Pressures pressures;
    int min_steps = MIN_STEPS > 2 * orders + 2 ? MIN_STEPS : 2 * orders + 2;
    if (!solve_chambers(point, true, min_steps, &pressures, message)) {
        return false;
    }

    /* The sum of the piston forces, and their moments about x and y. */
    int steps = pressures.steps;
    double *loads = calloc(3 * (size_t)steps, sizeof(double));
    bool done = loads != NULL;
    for (int i = 0; done && i < steps; i++) {
        for (int j = 0; j < PISTONS; j++) {
            double angle = 2 * PI * (i + 1) / steps + 2 * PI * j / PISTONS;
            double pressure = pressures.chamber[(size_t)i * PISTONS + j];
            double piston_force = PISTON_AREA * (pressure - CASE_PRESSURE);
            loads[i] += piston_force;
            loads[steps + i] += PITCH_RADIUS * piston_force * cos(angle);
            loads[2 * (size_t)steps + i] += PITCH_RADIUS * piston_force * sin(angle);
        }
    }
    free_pressures(&pressures);
    done = done && add_lines_of_loads(loads, steps, 2 * PI / steps, 0.0, PRESSURE_SHARES, orders,
                                      force);
    free(loads);
    if (!done) {
        snprintf(message, MESSAGE_SIZE, "Out of memory.");
        return false;
    }

    double unbalance = ROTOR_UNBALANCE * point->speed * point->speed;
    force[DOFS + ROTOR_X].re += unbalance;
    force[DOFS + ROTOR_Y].im -= unbalance;
    return true;
}

/* Add the forces by which the fault's displacement strains films, or by which inertia resists. */
static void add_fault_forces(const OperatingPoint *point, int orders, const Complex *motion,
                             Complex *force)
{
    for (int k = 1; k <= orders; k++) {
        double frequency = k * point->speed;
        Complex x = motion[k];
        Complex slipper = {K_SLIPPER_SWASH * x.re - C_SLIPPER_SWASH * frequency * x.im,
                           K_SLIPPER_SWASH * x.im + C_SLIPPER_SWASH * frequency * x.re};
        Complex bore = {K_PISTON_BORE * x.re - C_PISTON_BORE * frequency * x.im,
                        K_PISTON_BORE * x.im + C_PISTON_BORE * frequency * x.re};
        double inertia = 0.0;
        if (FAULT == RECESS && !RECESS_STRAINS_FILMS) {
            inertia = FAULT_GAIN * PISTON_SLIPPER_MASS / cos(SWASH_ANGLE) * frequency * frequency *
                      followed_share(frequency / (2 * PI));
        }
        for (int dof = 0; dof < DOFS; dof++) {
            Complex *target = force + (size_t)k * DOFS + dof;
            double film = EXCITATION_FACTOR * FILM_VECTOR[dof];
            double lateral = EXCITATION_FACTOR * BORE_VECTOR[dof];
            double direct = EXCITATION_FACTOR * inertia * SLIPPER_VECTOR[dof];
            target->re += film * slipper.re + lateral * bore.re + direct * x.re;
            target->im += film * slipper.im + lateral * bore.im + direct * x.im;
        }
    }
}

/* Mark the orders that pressures or the fault excite; the others are rounding. */
static void mark_active(int orders, const Complex *pressure, const Complex *motion, bool *active)
{
    double max_load = 0.0;
    double max_motion = 0.0;
    for (int k = 1; k <= orders; k++) {
        for (int dof = 0; dof < DOFS; dof++) {
            max_load = fmax(max_load, magnitude(pressure[(size_t)k * DOFS + dof]));
        }
        max_motion = fmax(max_motion, magnitude(motion[k]));
    }
    for (int k = 1; k <= orders; k++) {
        double load = 0.0;
        for (int dof = 0; dof < DOFS; dof++) {
            load = fmax(load, magnitude(pressure[(size_t)k * DOFS + dof]));
        }
        active[k] = FAULT == TILTED_BLOCK_FACE || load > NEGLIGIBLE_SHARE * max_load ||
                    magnitude(motion[k]) > NEGLIGIBLE_SHARE * max_motion;
    }
}

/* Solve (K + i omega C - omega^2 M) x = force by elimination with pivots; x replaces force. */
static void solve_motion(double frequency, double k_block_valve, double c_block_valve, Complex *x)
{
    Complex a[DOFS][DOFS];
    for (int i = 0; i < DOFS; i++) {
        for (int j = 0; j < DOFS; j++) {
            double stiffness = STIFFNESS[i][j] + k_block_valve * BLOCK_VALVE_SHAPE[i][j];
            double damping = DAMPING[i][j] + c_block_valve * BLOCK_VALVE_SHAPE[i][j];
            a[i][j].re = stiffness - (i == j ? frequency * frequency * MASS[i] : 0.0);
            a[i][j].im = frequency * damping;
        }
    }

    for (int column = 0; column < DOFS; column++) {
        int pivot = column;
        double largest = -1.0;
        for (int i = column; i < DOFS; i++) {
            double size = a[i][column].re * a[i][column].re + a[i][column].im * a[i][column].im;
            if (size > largest) {
                largest = size;
                pivot = i;
            }
        }
        if (pivot != column) {
            for (int j = column; j < DOFS; j++) {
                Complex swapped = a[column][j];
                a[column][j] = a[pivot][j];
                a[pivot][j] = swapped;
            }
            Complex swapped = x[column];
            x[column] = x[pivot];
            x[pivot] = swapped;
        }

        for (int i = column + 1; i < DOFS; i++) {
            if (a[i][column].re == 0.0 && a[i][column].im == 0.0) {
                continue;
            }
            Complex factor = divide(a[i][column], a[column][column]);
            for (int j = column + 1; j < DOFS; j++) {
                a[i][j].re -= factor.re * a[column][j].re - factor.im * a[column][j].im;
                a[i][j].im -= factor.re * a[column][j].im + factor.im * a[column][j].re;
            }
            Complex change = multiply(factor, x[column]);
            x[i].re -= change.re;
            x[i].im -= change.im;
        }
    }

    for (int i = DOFS - 1; i >= 0; i--) {
        for (int j = i + 1; j < DOFS; j++) {
            Complex known = multiply(a[i][j], x[j]);
            x[i].re -= known.re;
            x[i].im -= known.im;
        }
        x[i] = divide(x[i], a[i][i]);
    }
}

/* Solve all active orders; `force` becomes the motion. */
static void solve_lines(const OperatingPoint *point, int orders, const bool *active, Complex *force)
{
    double k_block_valve = K_BLOCK_VALVE;
    double c_block_valve = C_BLOCK_VALVE;
    if (FAULT == VALVE_PLATE_WEAR) {
        /* A thicker film is softer. */
        double ratio = VALVE_PLATE_FILM / (VALVE_PLATE_FILM + point->severity);
        k_block_valve *= pow(ratio, FAULT_STIFFNESS_EXPONENT);
        c_block_valve *= ratio * ratio * ratio;
    }
    for (int k = 0; k <= orders; k++) {
        if (active[k]) {
            Complex *line = force + (size_t)k * DOFS;
            solve_motion(k * point->speed, k_block_valve, c_block_valve, line);
        }
    }
}

/* Subtract the reaction of a stiffness Re(amplitude exp(i theta)), which turns with the shaft, to a
   motion, and so couples each order with its neighbors. */
static void subtract_turning_force(double scale, int orders, const Complex *motion, Complex *force)
{
    for (int k = 0; k <= orders; k++) {
        for (int i = 0; i < DOFS; i++) {
            Complex sum = {0, 0};
            for (int j = 0; j < DOFS; j++) {
                double re = TURNING_STIFFNESS[i][j][0];
                double im = TURNING_STIFFNESS[i][j][1];
                if (re == 0.0 && im == 0.0) {
                    continue;
                }
                /* Two-sided lines: half of the one-sided ones, conjugate at negative orders. */
                Complex below = {0, 0};
                Complex above = {0, 0};
                if (k >= 2) {
                    below.re = motion[(size_t)(k - 1) * DOFS + j].re / 2;
                    below.im = motion[(size_t)(k - 1) * DOFS + j].im / 2;
                } else if (k == 1) {
                    below.re = motion[j].re;
                } else if (orders >= 1) {
                    below.re = motion[DOFS + j].re / 2;
                    below.im = -motion[DOFS + j].im / 2;
                }
                if (k + 1 <= orders) {
                    above.re = motion[(size_t)(k + 1) * DOFS + j].re / 2;
                    above.im = motion[(size_t)(k + 1) * DOFS + j].im / 2;
                }
                sum.re += (re * below.re - im * below.im + re * above.re + im * above.im) / 2;
                sum.im += (re * below.im + im * below.re + re * above.im - im * above.re) / 2;
            }
            double sides = k == 0 ? 1.0 : 2.0;
            force[(size_t)k * DOFS + i].re -= scale * sides * sum.re;
            force[(size_t)k * DOFS + i].im -= scale * sides * (k == 0 ? 0.0 : sum.im);
        }
    }
}

/* Solve a pump whose stiffness turns with the shaft, by fixed-point iteration: the turning part
   acts as a force that is updated until it no longer changes. */
static bool solve_turning_lines(const OperatingPoint *point, int orders, bool *active,
                                Complex *force, char *message)
{
    size_t size = (size_t)(orders + 1) * DOFS;
    Complex *motion = malloc(sizeof(Complex) * 2 * size);
    if (motion == NULL) {
        snprintf(message, MESSAGE_SIZE, "Out of memory.");
        return false;
    }
    Complex *updated = motion + size;
    active[0] = true;
    memcpy(motion, force, sizeof(Complex) * size);
    solve_lines(point, orders, active, motion);

    double change = 0.0;
    double largest = 0.0;
    for (int iteration = 0; iteration < TURNING_ITERATIONS; iteration++) {
        memcpy(updated, force, sizeof(Complex) * size);
        subtract_turning_force(point->severity, orders, motion, updated);
        solve_lines(point, orders, active, updated);
        change = 0.0;
        largest = 0.0;
        for (size_t i = 0; i < size; i++) {
            Complex difference = {updated[i].re - motion[i].re, updated[i].im - motion[i].im};
            change = fmax(change, magnitude(difference));
            largest = fmax(largest, magnitude(updated[i]));
        }
        memcpy(motion, updated, sizeof(Complex) * size);
        if (change <= TURNING_TOLERANCE * largest) {
            break;
        }
    }
    memcpy(force, motion, sizeof(Complex) * size);
    free(motion);
    if (!(change <= TURNING_ROUNDING * largest)) {
        snprintf(message, MESSAGE_SIZE,
                 "The part of the stiffness that turns with the shaft is too large for the "
                 "iteration: lower " FAULT_SEVERITY_NAME ".");
        return false;
    }
    return true;
}

/* Return what stands between the rigid shell and a sensor at a frequency [Hz]. */
static Complex sensor_path(int sensor, double frequency)
{
    Complex sum = {1.0, 0.0};
    for (int mode = 0; mode < PATH_MODES; mode++) {
        double natural = PATH_FREQUENCY[mode];
        Complex square = {PATH_RESIDUE[sensor][mode] * frequency * frequency, 0.0};
        Complex dynamic = {natural * natural - frequency * frequency,
                           2 * PATH_DAMPING_RATIO[mode] * natural * frequency};
        Complex answer = divide(square, dynamic);
        sum.re += answer.re;
        sum.im += answer.im;
    }
    sum.re *= SENSOR_GAIN[sensor];
    sum.im *= SENSOR_GAIN[sensor];
    return sum;
}

/* Fill lines and revolution of each sensor from the motion of the shell. */
static bool read_sensors(Twin *twin, const OperatingPoint *point, int orders, const bool *active,
                         const Complex *motion)
{
    int grid = power_of_two(POINTS_PER_PERIOD * (orders + 1));
    Complex *wave = malloc(sizeof(Complex) * (size_t)grid);
    if (wave == NULL) {
        return false;
    }
    bool done = true;
    for (int sensor = 0; done && sensor < SENSORS; sensor++) {
        memset(wave, 0, sizeof(Complex) * (size_t)grid);
        for (int k = 1; k <= orders; k++) {
            Complex line = {0, 0};
            if (active[k]) {
                double frequency = k * point->speed;
                for (int dof = 0; dof < SHELL_DOFS; dof++) {
                    Complex x = motion[(size_t)k * DOFS + dof];
                    line.re += SENSOR_ROWS[sensor][dof] * x.re;
                    line.im += SENSOR_ROWS[sensor][dof] * x.im;
                }
                line.re *= -frequency * frequency;
                line.im *= -frequency * frequency;
                line = multiply(line, sensor_path(sensor, frequency / (2 * PI)));
            }
            twin->line[sensor][k] = line;
            wave[k] = line;
        }
        done = fourier_transform(wave, grid, 1);
        for (int i = 0; done && i < grid; i++) {
            twin->revolution[sensor][i] = wave[i].re;
        }
    }
    free(wave);
    twin->grid = grid;
    return done;
}

bool twin_accepts(const OperatingPoint *point, char *message)
{
    if (!(point->speed >= MIN_SPEED && point->speed <= MAX_SPEED)) {
        snprintf(message, MESSAGE_SIZE, "speed (%.6g rad/s) must lie in %.6g...%.6g rad/s.",
                 point->speed, MIN_SPEED, MAX_SPEED);
        return false;
    }
    if (!(point->discharge_pressure > SUCTION_PRESSURE &&
          point->discharge_pressure <= MAX_PRESSURE)) {
        snprintf(message, MESSAGE_SIZE,
                 "discharge_pressure (%.6g Pa) must lie above the suction pressure (%.6g Pa), and "
                 "not above %.6g Pa.",
                 point->discharge_pressure, SUCTION_PRESSURE, MAX_PRESSURE);
        return false;
    }
    if (FAULT != NO_FAULT && !(point->severity >= 0)) {
        snprintf(message, MESSAGE_SIZE, FAULT_SEVERITY_NAME " (%.6g) must not be negative.",
                 point->severity);
        return false;
    }
    if (FAULT != NO_FAULT && point->severity > MAX_SEVERITY) {
        snprintf(message, MESSAGE_SIZE, FAULT_SEVERITY_NAME " (%.6g, in SI units) exceeds %.6g.",
                 point->severity, MAX_SEVERITY);
        return false;
    }
    return true;
}

bool twin_solve(Twin *twin, const OperatingPoint *point)
{
    if (!twin_accepts(point, twin->message)) {
        return false;
    }
    int orders = (int)(BANDWIDTH / (point->speed / (2 * PI)));
    size_t size = (size_t)(orders + 1) * DOFS;
    Complex *force = calloc(size, sizeof(Complex));
    Complex *motion = calloc((size_t)orders + 1, sizeof(Complex));
    bool *active = calloc((size_t)orders + 1, sizeof(bool));

    bool done = force != NULL && motion != NULL && active != NULL;
    if (!done) {
        snprintf(twin->message, MESSAGE_SIZE, "Out of memory.");
    }
    done = done && add_pressure_lines(point, orders, force, twin->message);
    if (FAULT == LOOSE_SLIPPER) {
        done = done && add_loose_slipper_lines(point, orders, force, twin->message);
    }
    done = done && fault_motion_lines(point, orders, motion, twin->message);
    if (done) {
        mark_active(orders, force, motion, active);
        add_fault_forces(point, orders, motion, force);
        if (FAULT == TILTED_BLOCK_FACE) {
            done = solve_turning_lines(point, orders, active, force, twin->message);
        } else {
            solve_lines(point, orders, active, force);
        }
    }
    if (done && !read_sensors(twin, point, orders, active, force)) {
        snprintf(twin->message, MESSAGE_SIZE, "Out of memory.");
        done = false;
    }
    if (done) {
        twin->point = *point;
        twin->orders = orders;
    }
    free(active);
    free(motion);
    free(force);
    return done;
}
