/* Time per simulated second of an FMU (FMI 2.0, co-simulation), without a tool in between.

     fmu_speed BINARY GUID STEPS_PER_SECOND SECONDS SENSORS SPEED_RAMP

   Each step ends with reading the accelerations. SPEED_RAMP [rad/s^2] changes the input `speed` in
   each step, so that each revolution needs another solution. Prints the wall time [s]. */

#define _POSIX_C_SOURCE 199309L

#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "fmi2Functions.h"

#define MAX_SENSORS 64
#define VR_SPEED 0
#define VR_ACCELERATION 4

static double wall_time(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void log_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
                        fmi2String category, fmi2String message, ...)
{
    (void)environment;
    (void)name;
    (void)status;
    (void)category;
    fprintf(stderr, "%s\n", message);
}

int main(int count, char **arguments)
{
    if (count != 7) {
        fprintf(stderr, "fmu_speed BINARY GUID STEPS_PER_SECOND SECONDS SENSORS SPEED_RAMP\n");
        return 2;
    }
    void *library = dlopen(arguments[1], RTLD_NOW | RTLD_LOCAL);
    if (library == NULL) {
        fprintf(stderr, "%s\n", dlerror());
        return 1;
    }
    double step = 1 / atof(arguments[3]);
    long steps = (long)(atof(arguments[3]) * atof(arguments[4]));
    size_t sensors = (size_t)atoi(arguments[5]);
    double ramp = atof(arguments[6]);
    if (sensors > MAX_SENSORS) {
        return 2;
    }

    fmi2InstantiateTYPE *instantiate = (fmi2InstantiateTYPE *)dlsym(library, "fmi2Instantiate");
    fmi2EnterInitializationModeTYPE *enter =
        (fmi2EnterInitializationModeTYPE *)dlsym(library, "fmi2EnterInitializationMode");
    fmi2ExitInitializationModeTYPE *leave =
        (fmi2ExitInitializationModeTYPE *)dlsym(library, "fmi2ExitInitializationMode");
    fmi2DoStepTYPE *do_step = (fmi2DoStepTYPE *)dlsym(library, "fmi2DoStep");
    fmi2GetRealTYPE *get_real = (fmi2GetRealTYPE *)dlsym(library, "fmi2GetReal");
    fmi2SetRealTYPE *set_real = (fmi2SetRealTYPE *)dlsym(library, "fmi2SetReal");
    fmi2CallbackFunctions callbacks = {log_message, calloc, free, NULL, NULL};
    fmi2Component instance =
        instantiate("speed", fmi2CoSimulation, arguments[2], "", &callbacks, fmi2False, fmi2False);
    if (instance == NULL || enter(instance) != fmi2OK || leave(instance) != fmi2OK) {
        return 1;
    }

    fmi2ValueReference references[MAX_SENSORS];
    for (size_t sensor = 0; sensor < sensors; sensor++) {
        references[sensor] = VR_ACCELERATION + (fmi2ValueReference)sensor;
    }
    fmi2ValueReference speed_reference = VR_SPEED;
    double speed;
    get_real(instance, &speed_reference, 1, &speed);

    double acceleration[MAX_SENSORS];
    double start = wall_time();
    for (long i = 0; i < steps; i++) {
        if (ramp != 0) {
            speed += ramp * step;
            set_real(instance, &speed_reference, 1, &speed);
        }
        if (do_step(instance, (double)i * step, step, fmi2True) != fmi2OK) {
            return 1;
        }
        get_real(instance, references, sensors, acceleration);
    }
    printf("%.9g\n", wall_time() - start);
    return 0;
}
