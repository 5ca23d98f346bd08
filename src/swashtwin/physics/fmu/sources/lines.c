/* Part of swashtwin. Copyright the swashtwin developers; SPDX-License-Identifier: BSD-3-Clause */

/* Order lines of periodic signals. */

#include "pump_twin.h"

#include <math.h>
#include <stdlib.h>

/* Return the remainder of a division, between 0 and the divisor. */
double positive_remainder(double value, double divisor)
{
    double remainder = fmod(value, divisor);
    return remainder < 0 ? remainder + divisor : remainder;
}

/* Interpolate linearly in values over a revolution, the first of which belongs to the angle
   `first` [rad] and the next ones to equal steps. */
double interpolate_periodic(const double *values, size_t stride, int count, double first,
                            double angle)
{
    double position = positive_remainder(angle - first, 2 * PI) * count / (2 * PI);
    int index = (int)position;
    double weight = position - index;
    const double *low = values + (size_t)(index % count) * stride;
    const double *high = values + (size_t)((index + 1) % count) * stride;
    return *low * (1 - weight) + *high * weight;
}

int power_of_two(int min_size)
{
    int size = 1;
    while (size < min_size) {
        size *= 2;
    }
    return size;
}

/* Cooley and Tukey's transform of radix 2, in place. */
bool fourier_transform(Complex *z, int n, int sign)
{
    Complex *root = malloc(sizeof(Complex) * (size_t)(n > 1 ? n / 2 : 1));
    if (root == NULL) {
        return false;
    }
    for (int k = 0; k < n / 2; k++) {
        root[k].re = cos(2 * PI * k / n);
        root[k].im = sign * sin(2 * PI * k / n);
    }

    /* Order the elements by their indices with the bits reversed. */
    for (int i = 1, j = 0; i < n; i++) {
        int bit = n / 2;
        while (j & bit) {
            j ^= bit;
            bit /= 2;
        }
        j |= bit;
        if (i < j) {
            Complex swapped = z[i];
            z[i] = z[j];
            z[j] = swapped;
        }
    }

    for (int length = 2; length <= n; length *= 2) {
        int half = length / 2;
        int stride = n / length;
        for (int start = 0; start < n; start += length) {
            for (int k = 0; k < half; k++) {
                Complex w = root[k * stride];
                Complex *low = z + start + k;
                Complex *high = low + half;
                double re = high->re * w.re - high->im * w.im;
                double im = high->re * w.im + high->im * w.re;
                high->re = low->re - re;
                high->im = low->im - im;
                low->re += re;
                low->im += im;
            }
        }
    }
    free(root);
    return true;
}

/* Fill sum_i x_i exp(-2 pi i k m / steps) of three loads for the orders 0...orders, by sums. */
static bool sum_over_revolution(const double *loads, int steps, int orders, Complex *lines[3])
{
    double *cosine = malloc(sizeof(double) * 2 * (size_t)steps);
    if (cosine == NULL) {
        return false;
    }
    double *sine = cosine + steps;
    for (int i = 0; i < steps; i++) {
        cosine[i] = cos(2 * PI * i / steps);
        sine[i] = sin(2 * PI * i / steps);
    }

    const double *first = loads;
    const double *second = loads + steps;
    const double *third = loads + 2 * (size_t)steps;
    for (int k = 0; k <= orders; k++) {
        Complex a = {0, 0};
        Complex b = {0, 0};
        Complex c = {0, 0};
        int turn = 0; /* k i modulo the steps of a revolution */
        for (int i = 0; i < steps; i++) {
            a.re += first[i] * cosine[turn];
            a.im -= first[i] * sine[turn];
            b.re += second[i] * cosine[turn];
            b.im -= second[i] * sine[turn];
            c.re += third[i] * cosine[turn];
            c.im -= third[i] * sine[turn];
            turn += k;
            if (turn >= steps) {
                turn -= steps;
            }
        }
        lines[0][k] = a;
        lines[1][k] = b;
        lines[2][k] = c;
    }
    free(cosine);
    return true;
}

/* The same by a fast transform; the number of steps is a power of two. */
static bool transform_revolution(const double *loads, int steps, int orders, Complex *lines[3])
{
    Complex *z = malloc(sizeof(Complex) * (size_t)steps);
    bool done = z != NULL;
    for (int load = 0; done && load < 3; load++) {
        for (int i = 0; i < steps; i++) {
            z[i].re = loads[(size_t)load * steps + i];
            z[i].im = 0;
        }
        done = fourier_transform(z, steps, -1);
        for (int k = 0; k <= orders; k++) {
            lines[load][k] = z[k];
        }
    }
    free(z);
    return done;
}

bool add_lines_of_loads(const double *loads, int steps, double first_angle, double ahead,
                        const double shares[DOFS][3], int orders, Complex *force)
{
    Complex *memory = malloc(sizeof(Complex) * 3 * (size_t)(orders + 1));
    if (memory == NULL) {
        return false;
    }
    Complex *lines[3] = {memory, memory + (orders + 1), memory + 2 * (orders + 1)};
    bool is_fast = power_of_two(steps) == steps;
    bool done = is_fast ? transform_revolution(loads, steps, orders, lines)
                        : sum_over_revolution(loads, steps, orders, lines);

    for (int k = 0; done && k <= orders; k++) {
        /* From the first element's angle, and another piston's clock, to the shaft's zero. */
        double scale = (k == 0 ? 1.0 : 2.0) / steps;
        double shift = k * (ahead - first_angle);
        double c = scale * cos(shift);
        double s = scale * sin(shift);
        for (int dof = 0; dof < DOFS; dof++) {
            Complex *target = force + (size_t)k * DOFS + dof;
            for (int load = 0; load < 3; load++) {
                Complex line = lines[load][k];
                target->re += shares[dof][load] * (line.re * c - line.im * s);
                target->im += shares[dof][load] * (line.re * s + line.im * c);
            }
        }
    }
    free(memory);
    return done;
}
