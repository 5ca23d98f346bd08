/* Part of swashtwin. Copyright the swashtwin developers; SPDX-License-Identifier: BSD-3-Clause */

/* Twin of an axial piston pump: what its accelerometers read in steady state.

   At an operating point the twin solves, as swashtwin does in Python:

     chambers.c       the pressure of each chamber over a revolution,
     loose_slipper.c  the rattling of a piston in a worn ball joint, if that is the fault,
     fault.c          what a fault displaces,
     steady_state.c   the forces on 13 degrees of freedom, their motion, and the sensors' readings,

   line by line of the shaft orders k = 1, 2, ..., with x(theta) = X_0 + Re sum_k X_k exp(i k theta).
   theta is the shaft angle [rad], 0 at top dead center of piston 0.

   Equations: docs/explanation/physics.md of swashtwin. Units are SI. Numbers of this pump and this
   fault are in pump_numbers.h, which swashtwin writes. C99; needs only the C library and libm. */

#ifndef PUMP_TWIN_H
#define PUMP_TWIN_H

#include <stdbool.h>
#include <stddef.h>

#define PI 3.14159265358979323846
#define MESSAGE_SIZE 256

/* Degrees of freedom: x, y, z and tilts about x and y of shell and rotor; x, y, z of the retainer. */
#define DOFS 13
#define SHELL_DOFS 5
#define ROTOR_X 5
#define ROTOR_Y 6

/* Kinds of faults, one of which is FAULT. */
enum {
    NO_FAULT,
    RECESS,
    PISTON_WEAR,
    BORE_DEFECT,
    SEALING_LAND_SCRATCH,
    TILTED_BLOCK_FACE,
    VALVE_PLATE_WEAR,
    DAM_SCRATCH,
    GROOVE_EROSION,
    LOOSE_SLIPPER
};

#include "pump_numbers.h"

/* Without <complex.h>, which not every C compiler has. */
typedef struct {
    double re;
    double im;
} Complex;

typedef struct {
    double speed;              /* of the shaft [rad/s] */
    double discharge_pressure; /* absolute [Pa] */
    double severity;           /* of the fault [SI]: what its first dimension is */
} OperatingPoint;

/* Pressures over a revolution: element i belongs to the shaft angle 2 pi (i + 1) / steps. */
typedef struct {
    int steps;
    double *chamber; /* [step * PISTONS + piston], Pa */
    double *line;    /* outlet line [step], Pa */
} Pressures;

typedef struct {
    OperatingPoint point;
    int orders;             /* shaft orders within BANDWIDTH */
    Complex *line[SENSORS]; /* acceleration of each sensor [order], m/s^2; order 0 is unused */
    int grid;               /* points of `revolution`, a power of two */
    double *revolution[SENSORS]; /* acceleration over the shaft angle [point], m/s^2 */
    char message[MESSAGE_SIZE];  /* why the last solution failed */
} Twin;

/* Return a twin that has not been solved, or NULL without memory. */
Twin *twin_create(void);
void twin_free(Twin *twin);

/* Return whether an operating point is one of a pump, with a message if it is not. */
bool twin_accepts(const OperatingPoint *point, char *message);

/* Solve the steady state at an operating point. Return false, with a message, if there is none;
   the twin then keeps its last solution. */
bool twin_solve(Twin *twin, const OperatingPoint *point);

/* Return the amplitude of a shaft order [m/s^2], 0 above BANDWIDTH. */
double twin_line_amplitude(const Twin *twin, int sensor, int order);

/* Fill the acceleration of each sensor [m/s^2] at a shaft angle [rad]. */
void twin_acceleration(const Twin *twin, double angle, double acceleration[SENSORS]);


/* What follows is shared by the files of the twin only. */

/* chambers.c */
typedef struct {
    double suction;        /* flow over the root of the pressure difference [m^3/(s Pa^0.5)] */
    double discharge;      /* the same through the discharge port */
    double volume;         /* [m^3] */
    double growth;         /* of the volume over the shaft angle [m^3/rad] */
    double leakage;        /* to the case [m^3/(s Pa)] */
    double piston_leakage; /* along the piston over its clearance cubed [1/(s Pa)] */
} ChamberAngle;

int chamber_steps(int min_steps);
bool solve_chambers(const OperatingPoint *point, bool with_fault, int min_steps,
                    Pressures *pressures, char *message);
void free_pressures(Pressures *pressures);
void chamber_at(const OperatingPoint *point, bool with_fault, double angle, ChamberAngle *chamber);
double orifice_flow(double opening, double difference, double *slope);

/* fault.c */
bool fault_motion_lines(const OperatingPoint *point, int orders, Complex *motion, char *message);
double recess_depth(const OperatingPoint *point);
double recess_height(const OperatingPoint *point, double angle, double *slope);
double followed_share(double frequency);

/* loose_slipper.c: adds the forces of the loose slipper to the lines [order * DOFS + dof]. */
bool add_loose_slipper_lines(const OperatingPoint *point, int orders, Complex *force,
                             char *message);

/* lines.c */
double positive_remainder(double value, double divisor);
double interpolate_periodic(const double *values, size_t stride, int count, double first,
                            double angle);
int power_of_two(int min_size);
/* Replace z by sum_m z_m exp(sign 2 pi i k m / n); n is a power of two. */
bool fourier_transform(Complex *z, int n, int sign);
/* Add the lines of three loads (a force, its moments about x and y), through their shares in the
   degrees of freedom, to `force` [order * DOFS + dof]. The loads [load * steps + step] begin at
   `first_angle` [rad] on a clock that is `ahead` [rad] of the shaft's. */
bool add_lines_of_loads(const double *loads, int steps, double first_angle, double ahead,
                        const double shares[DOFS][3], int orders, Complex *force);

#endif
