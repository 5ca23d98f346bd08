/* Part of swashtwin. Copyright the swashtwin developers; SPDX-License-Identifier: BSD-3-Clause */

/* Displacements that faults impose. */

#include "pump_twin.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define RIDE_STEPS 16384 /* time steps of a revolution; a loaded slipper falls by 0.07 mm in 80 us */

/* Return the depth [m] that a slipper reaches in the recess. */
double recess_depth(const OperatingPoint *point)
{
    return point->severity * FAULT_DEPTH_SHARE;
}

/* Return the displacement [m] of a slipper at a shaft angle, and fill its slope [m/rad]: entry,
   dwell and exit, symmetric about the middle of the recess. */
double recess_height(const OperatingPoint *point, double angle, double *slope)
{
    double offset = positive_remainder(angle - FAULT_ANGLE + PI, 2 * PI) - PI;
    double inward = (FAULT_TOTAL_ANGLE / 2 - fabs(offset)) / FAULT_RISE_ANGLE;
    inward = fmin(fmax(inward, 0.0), 1.0);
    double rate = 0.0; /* at which `inward` changes */
    if (inward > 0 && inward < 1) {
        rate = (offset > 0 ? -1.0 : (offset < 0 ? 1.0 : 0.0)) / FAULT_RISE_ANGLE;
    }

    double depth = recess_depth(point);
    if (FAULT_IS_HALF_SINE) {
        double phase = PI / 2 * inward;
        *slope = depth * (PI / 2 * cos(phase)) * rate;
        return depth * sin(phase);
    }
    double phase = PI * inward;
    *slope = depth * (PI / 2 * sin(phase)) * rate;
    return depth * ((1 - cos(phase)) / 2);
}

/* Return the share of a recess that slippers follow at a frequency [Hz]. */
double followed_share(double frequency)
{
    if (FAULT_CORNER > 0) {
        return exp2(-pow(frequency / FAULT_CORNER, FAULT_FALL));
    }
    if (RECESS_STRAINS_FILMS) {
        return 1.0;
    }
    return exp(-(frequency / CONTACT_CUTOFF) * (frequency / CONTACT_CUTOFF));
}

/* Return the force along the shaft [N] that presses a slipper on, as in a healthy pump. */
static double pressing_force(const OperatingPoint *point, const Pressures *healthy, double angle)
{
    double pressure = interpolate_periodic(healthy->chamber, PISTONS, healthy->steps,
                                           2 * PI / healthy->steps, angle);
    double force = PISTON_AREA * (pressure - CASE_PRESSURE) + SPRING_PRELOAD / PISTONS;
    double lift = PITCH_RADIUS * tan(SWASH_ANGLE) * point->speed * point->speed;
    return fmax(force - PISTON_SLIPPER_MASS * lift * cos(angle), 0.0);
}

/* Fill the lines of a slipper that may leave the plate: it falls no faster than the force moves it,
   and never below the surface. */
static bool ride_lines(const OperatingPoint *point, int orders, Complex *motion, char *message)
{
    Pressures healthy;
    if (!solve_chambers(point, false, MIN_STEPS, &healthy, message)) {
        return false;
    }
    Complex *path = calloc(RIDE_STEPS, sizeof(Complex));
    if (path == NULL) {
        free_pressures(&healthy);
        snprintf(message, MESSAGE_SIZE, "Out of memory.");
        return false;
    }

    /* The march begins on the plate, one step before the recess. */
    int first = (int)((FAULT_ANGLE - FAULT_TOTAL_ANGLE / 2) / (2 * PI) * RIDE_STEPS) - 1;
    first = (first % RIDE_STEPS + RIDE_STEPS) % RIDE_STEPS;
    double step = 2 * PI / point->speed / RIDE_STEPS;
    double fall_of_force = step * step * cos(SWASH_ANGLE) / PISTON_SLIPPER_MASS;
    double previous = 0.0;
    double current = 0.0;
    for (int k = 1; k < RIDE_STEPS - 1; k++) {
        double slope;
        double angle = 2 * PI * ((first + k) % RIDE_STEPS) / RIDE_STEPS;
        double next_angle = 2 * PI * ((first + k + 1) % RIDE_STEPS) / RIDE_STEPS;
        double fall = fall_of_force * pressing_force(point, &healthy, angle);
        double surface = recess_height(point, next_angle, &slope);
        double next = fmin(2 * current - previous + fall, surface);
        path[(first + k + 1) % RIDE_STEPS].re = next;
        previous = current;
        current = next;
    }
    free_pressures(&healthy);

    bool done = fourier_transform(path, RIDE_STEPS, -1);
    for (int k = PISTONS; done && k <= orders; k += PISTONS) {
        motion[k].re = PISTONS * path[k].re * 2 / RIDE_STEPS;
        motion[k].im = PISTONS * path[k].im * 2 / RIDE_STEPS;
    }
    free(path);
    if (!done) {
        snprintf(message, MESSAGE_SIZE, "Out of memory.");
    }
    return done;
}

/* Fill the lines 0...orders of the fault's displacement [m]. */
bool fault_motion_lines(const OperatingPoint *point, int orders, Complex *motion, char *message)
{
    for (int k = 0; k <= orders; k++) {
        motion[k].re = 0.0;
        motion[k].im = 0.0;
    }
    if (FAULT == RECESS && RECESS_LIFTS_OFF) {
        return ride_lines(point, orders, motion, message);
    }
    if (FAULT != RECESS && FAULT != BORE_DEFECT) {
        return true;
    }

    for (int k = 1; k <= orders; k++) {
        double scale = point->severity;
        if (FAULT == RECESS && RECESS_STRAINS_FILMS) {
            scale *= followed_share(k * point->speed / (2 * PI));
        }
        motion[k].re = scale * UNIT_MOTION[k][0];
        motion[k].im = scale * UNIT_MOTION[k][1];
    }
    return true;
}
