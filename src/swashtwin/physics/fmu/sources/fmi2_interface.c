/* Part of swashtwin. Copyright the swashtwin developers; SPDX-License-Identifier: BSD-3-Clause */

/* Functional Mock-up Interface 2.0 for co-simulation of the twin.

   Quasi-steady: the accelerations are those of the steady state at the inputs that held when the
   current revolution of the shaft began, read at the shaft angle, which follows the speed at once.
   Inputs that change take effect at the start of the next revolution. Transients of the pressures
   and of the housing, which last about three revolutions, are not computed. */

/* pump_numbers.h defines FMI2_FUNCTION_PREFIX, which fmi2Functions.h takes. */
#include "pump_twin.h"

#include "fmi2Functions.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Value references of modelDescription.xml. */
enum {
    VR_SPEED = 0,
    VR_DISCHARGE_PRESSURE = 1,
    VR_SEVERITY = 2,
    VR_SHAFT_ANGLE = 3,
    VR_ACCELERATION = 4,                   /* of the first sensor; one for each sensor */
    VR_LINE = VR_ACCELERATION + SENSORS,   /* first order of the first sensor, sensor by sensor */
    VR_END = VR_LINE + SENSORS * LINE_ORDERS
};

typedef enum { INSTANTIATED, INITIALIZATION, STEPPING, TERMINATED, FAILED } State;

typedef struct {
    Twin *twin;
    State state;
    OperatingPoint inputs;
    bool is_solved;     /* whether the twin has a solution since the start */
    double shaft_angle; /* [rad], below a revolution */
    double acceleration[SENSORS];
    char *name;
    fmi2CallbackLogger logger;
    fmi2ComponentEnvironment environment;
} Instance;

static fmi2Status report(const Instance *instance, fmi2Status status, const char *message)
{
    if (instance != NULL && instance->logger != NULL) {
        /* The message is the format itself, for tools that do not format: it has no percent sign. */
        instance->logger(instance->environment, instance->name, status, "logStatusError", message);
    }
    return status;
}

static void set_start_values(Instance *instance)
{
    instance->state = INSTANTIATED;
    instance->inputs.speed = START_SPEED;
    instance->inputs.discharge_pressure = START_DISCHARGE_PRESSURE;
    instance->inputs.severity = START_SEVERITY;
    instance->is_solved = false;
    instance->shaft_angle = 0.0;
}

static void free_instance(Instance *instance)
{
    if (instance != NULL) {
        twin_free(instance->twin);
        free(instance->name);
        free(instance);
    }
}

static bool inputs_have_changed(const Instance *instance)
{
    const OperatingPoint *solved = &instance->twin->point;
    return !instance->is_solved || instance->inputs.speed != solved->speed ||
           instance->inputs.discharge_pressure != solved->discharge_pressure ||
           instance->inputs.severity != solved->severity;
}

/* Solve the twin at the inputs if they have changed. */
static fmi2Status follow_inputs(Instance *instance)
{
    if (inputs_have_changed(instance)) {
        if (!twin_solve(instance->twin, &instance->inputs)) {
            instance->state = FAILED;
            return report(instance, fmi2Error, instance->twin->message);
        }
        instance->is_solved = true;
    }
    twin_acceleration(instance->twin, instance->shaft_angle, instance->acceleration);
    return fmi2OK;
}

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

fmi2Status fmi2SetDebugLogging(fmi2Component component, fmi2Boolean on, size_t count,
                               const fmi2String categories[])
{
    /* Errors are always reported, and there is nothing else to log. */
    (void)component;
    (void)on;
    (void)count;
    (void)categories;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid,
                              fmi2String resources, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean logging)
{
    (void)resources;
    (void)visible;
    (void)logging;
    Instance *instance = calloc(1, sizeof(Instance));
    if (instance == NULL) {
        return NULL;
    }
    if (functions != NULL) {
        instance->logger = functions->logger;
        instance->environment = functions->componentEnvironment;
    }
    const char *given_name = name != NULL ? name : "";
    instance->name = malloc(strlen(given_name) + 1);
    instance->twin = twin_create();
    if (instance->name == NULL || instance->twin == NULL) {
        report(instance, fmi2Error, "Out of memory.");
        free_instance(instance);
        return NULL;
    }
    strcpy(instance->name, given_name);

    if (type != fmi2CoSimulation || guid == NULL || strcmp(guid, MODEL_GUID) != 0) {
        report(instance, fmi2Error,
               type != fmi2CoSimulation
                   ? "This FMU is for co-simulation only."
                   : "The guid is not that of this FMU's modelDescription.xml: unpack it again.");
        free_instance(instance);
        return NULL;
    }
    set_start_values(instance);
    return instance;
}

void fmi2FreeInstance(fmi2Component component)
{
    free_instance(component);
}

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean has_tolerance,
                               fmi2Real tolerance, fmi2Real start_time, fmi2Boolean has_stop_time,
                               fmi2Real stop_time)
{
    (void)component;
    (void)has_tolerance;
    (void)tolerance;
    (void)start_time;
    (void)has_stop_time;
    (void)stop_time;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component component)
{
    Instance *instance = component;
    instance->state = INITIALIZATION;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component)
{
    Instance *instance = component;
    fmi2Status status = follow_inputs(instance);
    if (status == fmi2OK) {
        instance->state = STEPPING;
    }
    return status;
}

fmi2Status fmi2Terminate(fmi2Component component)
{
    Instance *instance = component;
    instance->state = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component component)
{
    set_start_values(component);
    return fmi2OK;
}

/* Return an input, or NULL if the value reference is not one of an input. */
static double *find_input(Instance *instance, fmi2ValueReference reference)
{
    switch (reference) {
    case VR_SPEED:
        return &instance->inputs.speed;
    case VR_DISCHARGE_PRESSURE:
        return &instance->inputs.discharge_pressure;
    case VR_SEVERITY:
        return FAULT == NO_FAULT ? NULL : &instance->inputs.severity;
    default:
        return NULL;
    }
}

fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       fmi2Real values[])
{
    Instance *instance = component;
    for (size_t i = 0; i < count; i++) {
        fmi2ValueReference reference = references[i];
        const double *input = find_input(instance, reference);
        if (input != NULL) {
            values[i] = *input;
            continue;
        }
        if (reference == VR_SHAFT_ANGLE) {
            values[i] = instance->shaft_angle;
            continue;
        }
        if (reference < VR_ACCELERATION || reference >= VR_END) {
            return report(instance, fmi2Error, "There is no variable with this value reference.");
        }

        /* During initialization outputs follow the inputs at once. */
        if (instance->state == INITIALIZATION && follow_inputs(instance) != fmi2OK) {
            return fmi2Error;
        }
        if (!instance->is_solved) {
            values[i] = 0.0;
        } else if (reference < VR_LINE) {
            values[i] = instance->acceleration[reference - VR_ACCELERATION];
        } else {
            int line = (int)(reference - VR_LINE);
            values[i] =
                twin_line_amplitude(instance->twin, line / LINE_ORDERS, line % LINE_ORDERS + 1);
        }
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       const fmi2Real values[])
{
    Instance *instance = component;
    for (size_t i = 0; i < count; i++) {
        double *input = find_input(instance, references[i]);
        if (input == NULL) {
            return report(instance, fmi2Error, "Only inputs can be set.");
        }
        *input = values[i];
    }
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real time, fmi2Real step,
                      fmi2Boolean no_earlier_state)
{
    (void)time;
    (void)no_earlier_state;
    Instance *instance = component;
    if (instance->state != STEPPING) {
        return report(instance, fmi2Error, "fmi2DoStep requires an initialized instance.");
    }
    if (!(step >= 0)) {
        return report(instance, fmi2Error, "The communication step must not be negative.");
    }
    if (!twin_accepts(&instance->inputs, instance->twin->message)) {
        instance->state = FAILED;
        return report(instance, fmi2Error, instance->twin->message);
    }

    double angle = instance->shaft_angle + instance->inputs.speed * step;
    if (!isfinite(angle)) {
        return report(instance, fmi2Error, "The communication step must be finite.");
    }
    instance->shaft_angle = positive_remainder(angle, 2 * PI);
    if (angle >= 2 * PI) {
        return follow_inputs(instance);
    }
    twin_acceleration(instance->twin, instance->shaft_angle, instance->acceleration);
    return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component component)
{
    return report(component, fmi2Error, "A step ends before it can be cancelled.");
}

/* The twin has variables of the type Real only, and none of what follows. */

static fmi2Status report_unsupported(const Instance *instance, size_t count)
{
    return count == 0 ? fmi2OK : report(instance, fmi2Error, "Not supported by this FMU.");
}

fmi2Status fmi2GetInteger(fmi2Component component, const fmi2ValueReference references[],
                          size_t count, fmi2Integer values[])
{
    (void)references;
    (void)values;
    return report_unsupported(component, count);
}

fmi2Status fmi2GetBoolean(fmi2Component component, const fmi2ValueReference references[],
                          size_t count, fmi2Boolean values[])
{
    (void)references;
    (void)values;
    return report_unsupported(component, count);
}

fmi2Status fmi2GetString(fmi2Component component, const fmi2ValueReference references[],
                         size_t count, fmi2String values[])
{
    (void)references;
    (void)values;
    return report_unsupported(component, count);
}

fmi2Status fmi2SetInteger(fmi2Component component, const fmi2ValueReference references[],
                          size_t count, const fmi2Integer values[])
{
    (void)references;
    (void)values;
    return report_unsupported(component, count);
}

fmi2Status fmi2SetBoolean(fmi2Component component, const fmi2ValueReference references[],
                          size_t count, const fmi2Boolean values[])
{
    (void)references;
    (void)values;
    return report_unsupported(component, count);
}

fmi2Status fmi2SetString(fmi2Component component, const fmi2ValueReference references[],
                         size_t count, const fmi2String values[])
{
    (void)references;
    (void)values;
    return report_unsupported(component, count);
}

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    (void)state;
    return report_unsupported(component, 1);
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state)
{
    (void)state;
    return report_unsupported(component, 1);
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    (void)component;
    (void)state;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component component, fmi2FMUstate state, size_t *size)
{
    (void)state;
    (void)size;
    return report_unsupported(component, 1);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[],
                                 size_t size)
{
    (void)state;
    (void)bytes;
    (void)size;
    return report_unsupported(component, 1);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *state)
{
    (void)bytes;
    (void)size;
    (void)state;
    return report_unsupported(component, 1);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component component,
                                        const fmi2ValueReference unknown[], size_t unknown_count,
                                        const fmi2ValueReference known[], size_t known_count,
                                        const fmi2Real known_change[], fmi2Real unknown_change[])
{
    (void)unknown;
    (void)known;
    (void)known_count;
    (void)known_change;
    (void)unknown_change;
    return report_unsupported(component, unknown_count);
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component component,
                                       const fmi2ValueReference references[], size_t count,
                                       const fmi2Integer orders[], const fmi2Real values[])
{
    (void)references;
    (void)orders;
    (void)values;
    return report_unsupported(component, count);
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component component,
                                        const fmi2ValueReference references[], size_t count,
                                        const fmi2Integer orders[], fmi2Real values[])
{
    (void)references;
    (void)orders;
    (void)values;
    return report_unsupported(component, count);
}

fmi2Status fmi2GetStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)kind;
    (void)value;
    return report_unsupported(component, 1);
}

fmi2Status fmi2GetRealStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Real *value)
{
    (void)kind;
    (void)value;
    return report_unsupported(component, 1);
}

fmi2Status fmi2GetIntegerStatus(fmi2Component component, const fmi2StatusKind kind,
                                fmi2Integer *value)
{
    (void)kind;
    (void)value;
    return report_unsupported(component, 1);
}

fmi2Status fmi2GetBooleanStatus(fmi2Component component, const fmi2StatusKind kind,
                                fmi2Boolean *value)
{
    (void)kind;
    (void)value;
    return report_unsupported(component, 1);
}

fmi2Status fmi2GetStringStatus(fmi2Component component, const fmi2StatusKind kind,
                               fmi2String *value)
{
    (void)kind;
    (void)value;
    return report_unsupported(component, 1);
}
