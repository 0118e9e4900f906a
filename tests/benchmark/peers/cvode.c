/* The reference steps solved with SUNDIALS: CVODE (BDF, Adams) and ARKODE (explicit Runge-Kutta).
 *
 *   apt-get install libsundials-dev                      (Debian 12 "bookworm": SUNDIALS 6.4.1)
 *   gcc -O3 -march=native -std=gnu11 -Wall -Wextra cvode.c -o cvode \
 *       -lsundials_cvode -lsundials_arkode -lsundials_nvecserial \
 *       -lsundials_sunmatrixdense -lsundials_sunlinsoldense -lm
 *   ./cvode ../../reference/steps_B --repeats 5
 *
 * Chosen, since no slower at the same error than what stands in brackets: the analytic Jacobian
 * (difference quotients), also for Adams (fixed-point iteration); for ARKODE the Cash-Karp pair
 * (Dormand-Prince, Fehlberg), cubic interpolation (quintic), and a reset that keeps the last step
 * size (a new estimate); the flow's reversal as an event (left to the error control).
 */

#include <arkode/arkode_erkstep.h>
#include <cvode/cvode.h>
#include <math.h>
#include <nvector/nvector_serial.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sundials/sundials_version.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <time.h>

#define CV_J_PER_KG_K 718.0
#define CP_J_PER_KG_K 1005.0
#define R_J_PER_KG_K 287.0
#define R_PER_CV (R_J_PER_KG_K / CV_J_PER_KG_K)
#define CP_PER_CV (CP_J_PER_KG_K / CV_J_PER_KG_K)
#define G_M_PER_S2 9.80665

#define NEARLY_NOW_S 1e-12 /* closer to a row than this is at the row */
#define MOST_STEPS 1000000

enum { CONTRACTION, RATE_PER_S, PRESSURE_PA, TEMPERATURE_K, STATES };
enum { MOTION_ROOT, DOWNWARD_ROOT, FLOW_ROOT, ROOTS };

static const double RANGES[STATES] = {0.25, 1.0, 4e5, 100.0};
static const double TOLERANCES[] = {1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 1e-8, 1e-9};

typedef struct {
    double alpha_m2, beta_m2, gamma_n, d1_m3, d2_m3, d3_m3, length_m;
    double weight_n, mass_length_kg_m, viscous_ns, coulomb_n, static_n; /* viscous: times length */
    double flow_gain_kg_per_pa_s, supply_pa, ambient_k, ambient_pa;
    double charging_w_per_m2_k, discharging_w_per_m2_k;
    /* What holds between two events. */
    double valve_pa; /* absolute reference */
    int motion;      /* 1: contracting, -1: lengthening, 0: at rest */
    bool sinkable;   /* at rest above the stop: known here, as the solvers let eps drift */
    bool charging;
} Plant;

typedef struct {
    int rows;
    double *time_s, *reference_pa, *contraction, *pressure_pa;
} Case;

/* CVODE's and ERKStep's calls have the same shapes and the same return codes. */
typedef struct {
    void *memory;
    int (*start)(void *, realtype, N_Vector);
    int (*restart)(void *, realtype, N_Vector);
    int (*set_stop_time)(void *, realtype);
    int (*evolve)(void *, realtype, N_Vector, realtype *, int);
    int (*get_roots)(void *, int *);
    int (*set_root_directions)(void *, int *);
} Solver;

static void require(bool good, const char *what) {
    if (!good) {
        fprintf(stderr, "cvode: %s\n", what);
        exit(1);
    }
}

/* Equations 1-5 and 9 ------------------------------------------------------------------------ */

static inline double volume_m3(const Plant *p, double eps) {
    return (p->d1_m3 * eps + p->d2_m3) * eps + p->d3_m3;
}

static inline double area_m2(const Plant *p, double eps) {
    return p->alpha_m2 * (1.0 - eps) * (1.0 - eps) + p->beta_m2;
}

/* Muscle force less weight, before friction. */
static inline double net_n(const Plant *p, const double *y) {
    double gauge_pa = y[PRESSURE_PA] - p->ambient_pa;
    return area_m2(p, y[CONTRACTION]) * gauge_pa + p->gamma_n - p->weight_n;
}

static int rates(realtype time_s, N_Vector state, N_Vector rate, void *plant) {
    (void)time_s;
    const Plant *p = plant;
    const double *y = N_VGetArrayPointer_Serial(state);
    double *dy = N_VGetArrayPointer_Serial(rate);
    double eps = y[CONTRACTION], rate_per_s = y[RATE_PER_S];
    double pressure_pa = y[PRESSURE_PA], gas_k = y[TEMPERATURE_K];

    dy[CONTRACTION] = dy[RATE_PER_S] = 0.0;
    if (p->motion != 0) {
        double friction_n = p->coulomb_n * p->motion + p->viscous_ns * rate_per_s;
        dy[CONTRACTION] = rate_per_s;
        dy[RATE_PER_S] = (net_n(p, y) - friction_n) / p->mass_length_kg_m;
    }
    double gas_m3 = volume_m3(p, eps), per_m3 = 1.0 / gas_m3;
    double flow_kg_per_s = p->flow_gain_kg_per_pa_s * (p->valve_pa - pressure_pa);
    double inflow_k = p->charging ? p->ambient_k : gas_k;
    double heat_w_per_m2_k = p->charging ? p->charging_w_per_m2_k : p->discharging_w_per_m2_k;
    double wall_m2 = 2.0 * sqrt(M_PI * gas_m3 * p->length_m * (1.0 - eps));
    double inlet_w = CP_J_PER_KG_K * flow_kg_per_s * inflow_k;
    inlet_w += heat_w_per_m2_k * wall_m2 * (p->ambient_k - gas_k);
    double work_w = pressure_pa * (2.0 * p->d1_m3 * eps + p->d2_m3) * rate_per_s;
    dy[PRESSURE_PA] = (R_PER_CV * inlet_w - CP_PER_CV * work_w) * per_m3;
    double left_w = inlet_w - work_w - CV_J_PER_KG_K * flow_kg_per_s * gas_k;
    dy[TEMPERATURE_K] = R_PER_CV * gas_k * per_m3 / pressure_pa * left_w;
    return 0;
}

static int jacobian(realtype time_s, N_Vector state, N_Vector rate, SUNMatrix matrix, void *plant,
                    N_Vector scratch1, N_Vector scratch2, N_Vector scratch3) {
    (void)time_s, (void)scratch1, (void)scratch2, (void)scratch3;
    const Plant *p = plant;
    const double *y = N_VGetArrayPointer_Serial(state);
    const double *dy = N_VGetArrayPointer_Serial(rate);
    realtype **column = SM_COLS_D(matrix);
    double eps = y[CONTRACTION], rate_per_s = y[RATE_PER_S];
    double pressure_pa = y[PRESSURE_PA], gas_k = y[TEMPERATURE_K];

    if (p->motion != 0) {
        double gauge_pa = pressure_pa - p->ambient_pa;
        column[RATE_PER_S][CONTRACTION] = 1.0;
        column[CONTRACTION][RATE_PER_S] =
            -2.0 * p->alpha_m2 * (1.0 - eps) * gauge_pa / p->mass_length_kg_m;
        column[RATE_PER_S][RATE_PER_S] = -p->viscous_ns / p->mass_length_kg_m;
        column[PRESSURE_PA][RATE_PER_S] = area_m2(p, eps) / p->mass_length_kg_m;
    }
    double gas_m3 = volume_m3(p, eps), slope_m3 = 2.0 * p->d1_m3 * eps + p->d2_m3;
    double bend_w = pressure_pa * 2.0 * p->d1_m3 * rate_per_s; /* P dV'/d(eps) d(eps)/dt */
    double flow_kg_per_s = p->flow_gain_kg_per_pa_s * (p->valve_pa - pressure_pa);
    double inflow_k = p->charging ? p->ambient_k : gas_k;
    double heat_w_per_m2_k = p->charging ? p->charging_w_per_m2_k : p->discharging_w_per_m2_k;
    double wall_m2 = 2.0 * sqrt(M_PI * gas_m3 * p->length_m * (1.0 - eps));
    double wall_slope_m2 =
        2.0 * M_PI * p->length_m * (slope_m3 * (1.0 - eps) - gas_m3) / wall_m2;

    double inlet_eps = heat_w_per_m2_k * wall_slope_m2 * (p->ambient_k - gas_k);
    double inlet_pa = -CP_J_PER_KG_K * p->flow_gain_kg_per_pa_s * inflow_k;
    double inlet_k = -heat_w_per_m2_k * wall_m2;
    inlet_k += p->charging ? 0.0 : CP_J_PER_KG_K * flow_kg_per_s;

    double relative_slope = slope_m3 / gas_m3;
    column[CONTRACTION][PRESSURE_PA] =
        (R_PER_CV * inlet_eps - CP_PER_CV * bend_w) / gas_m3 - dy[PRESSURE_PA] * relative_slope;
    column[RATE_PER_S][PRESSURE_PA] = -CP_PER_CV * pressure_pa * relative_slope;
    column[PRESSURE_PA][PRESSURE_PA] =
        (R_PER_CV * inlet_pa - CP_PER_CV * slope_m3 * rate_per_s) / gas_m3;
    column[TEMPERATURE_K][PRESSURE_PA] = R_PER_CV * inlet_k / gas_m3;

    double k_per_j = R_PER_CV * gas_k / (pressure_pa * gas_m3);
    double left_pa =
        inlet_pa - slope_m3 * rate_per_s + CV_J_PER_KG_K * p->flow_gain_kg_per_pa_s * gas_k;
    column[CONTRACTION][TEMPERATURE_K] =
        k_per_j * (inlet_eps - bend_w) - dy[TEMPERATURE_K] * relative_slope;
    column[RATE_PER_S][TEMPERATURE_K] = -k_per_j * pressure_pa * slope_m3;
    column[PRESSURE_PA][TEMPERATURE_K] = k_per_j * left_pa - dy[TEMPERATURE_K] / pressure_pa;
    column[TEMPERATURE_K][TEMPERATURE_K] =
        k_per_j * (inlet_k - CV_J_PER_KG_K * flow_kg_per_s) + dy[TEMPERATURE_K] / gas_k;
    return 0;
}

/* Events ------------------------------------------------------------------------------------- */

static int roots(realtype time_s, N_Vector state, realtype *root, void *plant) {
    (void)time_s;
    const Plant *p = plant;
    const double *y = N_VGetArrayPointer_Serial(state);
    root[DOWNWARD_ROOT] = 1.0;
    if (p->motion != 0) {
        root[MOTION_ROOT] = y[RATE_PER_S];
        if (p->motion < 0) root[DOWNWARD_ROOT] = y[CONTRACTION];
    } else {
        double force_n = net_n(p, y);
        root[MOTION_ROOT] = force_n - p->static_n;
        if (p->sinkable) root[DOWNWARD_ROOT] = force_n + p->static_n;
    }
    root[FLOW_ROOT] = p->valve_pa - y[PRESSURE_PA];
    return 0;
}

/* Only the first row starts a run: what a solver may keep over an event is lost in `start`. */
static void restart(const Solver *solver, const Plant *p, double time_s, N_Vector state,
                    bool first) {
    int (*again)(void *, realtype, N_Vector) = first ? solver->start : solver->restart;
    int directions[ROOTS] = {p->motion != 0 ? -p->motion : 1, -1, p->charging ? -1 : 1};
    require(solver->set_root_directions(solver->memory, directions) == 0, "root directions");
    require(again(solver->memory, time_s, state) == 0, "restart failed");
}

static void motion_from_rest(Plant *p, const double *y) {
    double force_n = net_n(p, y);
    p->motion = 0;
    p->sinkable = y[CONTRACTION] > 0.0;
    if (force_n > p->static_n) p->motion = 1;
    if (force_n < -p->static_n && p->sinkable) p->motion = -1;
}

/* Returns the number of events. */
static int change_mode(Plant *p, const int *root, double *y) {
    int events = 0;
    if (root[FLOW_ROOT]) {
        p->charging = !p->charging;
        events++;
    }
    if (root[MOTION_ROOT] || root[DOWNWARD_ROOT]) {
        events++;
        if (p->motion == 0) {
            p->motion = root[MOTION_ROOT] ? 1 : -1;
        } else {
            if (root[DOWNWARD_ROOT]) y[CONTRACTION] = 0.0;
            y[RATE_PER_S] = 0.0;
            motion_from_rest(p, y);
        }
    }
    return events;
}

/* One run; fills the rows and returns the number of events. */
static int simulate(const Solver *solver, Plant *p, const Case *measured, N_Vector state,
                    double *contraction, double *pressure_pa) {
    double *y = N_VGetArrayPointer_Serial(state), now_s = measured->time_s[0];
    int events = 0;
    y[CONTRACTION] = contraction[0] = measured->contraction[0];
    y[RATE_PER_S] = 0.0;
    pressure_pa[0] = measured->pressure_pa[0];
    y[PRESSURE_PA] = pressure_pa[0] + p->ambient_pa;
    y[TEMPERATURE_K] = p->ambient_k;
    motion_from_rest(p, y);
    for (int row = 1, end = 1; row < measured->rows; row++) {
        if (row == end) { /* the reference changed: find how long the new one is held */
            double reference_pa = measured->reference_pa[row - 1];
            while (end < measured->rows - 1 && measured->reference_pa[end] == reference_pa) end++;
            p->valve_pa = fmax(0.0, fmin(reference_pa, p->supply_pa)) + p->ambient_pa;
            p->charging = p->valve_pa > y[PRESSURE_PA];
            restart(solver, p, now_s, state, row == 1);
            solver->set_stop_time(solver->memory, measured->time_s[end]);
            end++;
        }
        while (measured->time_s[row] - now_s > NEARLY_NOW_S) {
            double row_s = measured->time_s[row];
            int flag = solver->evolve(solver->memory, row_s, state, &now_s, CV_NORMAL);
            require(flag >= 0, "integration failed");
            if (flag == CV_ROOT_RETURN) {
                int root[ROOTS];
                solver->get_roots(solver->memory, root);
                events += change_mode(p, root, y);
                restart(solver, p, now_s, state, false);
            }
        }
        now_s = measured->time_s[row];
        contraction[row] = y[CONTRACTION];
        pressure_pa[row] = y[PRESSURE_PA] - p->ambient_pa;
    }
    return events;
}

/* Solvers ------------------------------------------------------------------------------------ */

static Solver cvode(int method, Plant *p, double tolerance, N_Vector state, N_Vector absolute,
                    SUNContext context) {
    void *memory = CVodeCreate(method, context);
    require(memory && CVodeInit(memory, rates, 0.0, state) == 0, "CVodeInit");
    require(CVodeSVtolerances(memory, tolerance, absolute) == 0, "CVodeSVtolerances");
    require(CVodeSetUserData(memory, p) == 0, "CVodeSetUserData");
    require(CVodeSetMaxNumSteps(memory, MOST_STEPS) == 0, "CVodeSetMaxNumSteps");
    SUNMatrix matrix = SUNDenseMatrix(STATES, STATES, context);
    SUNLinearSolver linear = SUNLinSol_Dense(state, matrix, context);
    require(CVodeSetLinearSolver(memory, linear, matrix) == 0, "CVodeSetLinearSolver");
    require(CVodeSetJacFn(memory, jacobian) == 0, "CVodeSetJacFn");
    require(CVodeRootInit(memory, ROOTS, roots) == 0, "CVodeRootInit");
    CVodeSetNoInactiveRootWarn(memory);
    return (Solver){memory, CVodeReInit,      CVodeReInit,          CVodeSetStopTime,
                    CVode,  CVodeGetRootInfo, CVodeSetRootDirection};
}

static int start_erk(void *memory, realtype time_s, N_Vector state) {
    return ERKStepReInit(memory, rates, time_s, state);
}

static Solver erk(Plant *p, double tolerance, N_Vector state, N_Vector absolute,
                  SUNContext context) {
    void *memory = ERKStepCreate(rates, 0.0, state, context);
    require(memory && ERKStepSVtolerances(memory, tolerance, absolute) == 0, "ERKStepCreate");
    require(ERKStepSetUserData(memory, p) == 0, "ERKStepSetUserData");
    require(ERKStepSetMaxNumSteps(memory, MOST_STEPS) == 0, "ERKStepSetMaxNumSteps");
    require(ERKStepSetTableNum(memory, ARKODE_CASH_KARP_6_4_5) == 0, "ERKStepSetTableNum");
    require(ERKStepSetInterpolantDegree(memory, 3) == 0, "ERKStepSetInterpolantDegree");
    require(ERKStepRootInit(memory, ROOTS, roots) == 0, "ERKStepRootInit");
    ERKStepSetNoInactiveRootWarn(memory);
    return (Solver){memory,        start_erk,          ERKStepReset,           ERKStepSetStopTime,
                    ERKStepEvolve, ERKStepGetRootInfo, ERKStepSetRootDirection};
}

/* The case's files --------------------------------------------------------------------------- */

static FILE *open_file(const char *folder, const char *name) {
    char path[4096];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "r");
    require(file != NULL, path);
    return file;
}

/* A rig's keys differ from each other in all its sections. */
static double rig_value(const char *folder, const char *wanted) {
    FILE *file = open_file(folder, "rig.toml");
    char line[512], key[256];
    double value, found = NAN;
    while (fgets(line, sizeof line, file)) {
        if (sscanf(line, " %255[a-z0-9_] = %lf", key, &value) == 2 && !strcmp(key, wanted)) {
            found = value;
        }
    }
    fclose(file);
    require(!isnan(found), wanted);
    return found;
}

static Plant read_rig(const char *folder) {
    Plant p = {0};
    p.alpha_m2 = rig_value(folder, "alpha_m2");
    p.beta_m2 = rig_value(folder, "beta_m2");
    p.gamma_n = rig_value(folder, "gamma_n");
    p.d1_m3 = rig_value(folder, "volume_d1_m3");
    p.d2_m3 = rig_value(folder, "volume_d2_m3");
    p.d3_m3 = rig_value(folder, "volume_d3_m3");
    p.length_m = rig_value(folder, "initial_length_m");
    p.weight_n = rig_value(folder, "mass_kg") * G_M_PER_S2;
    p.mass_length_kg_m = rig_value(folder, "mass_kg") * p.length_m;
    p.viscous_ns = rig_value(folder, "viscous_damping_ns_per_m") * p.length_m;
    p.coulomb_n = rig_value(folder, "coulomb_friction_n");
    p.static_n = rig_value(folder, "static_friction_n");
    p.flow_gain_kg_per_pa_s = rig_value(folder, "flow_gain_kg_per_pa_s");
    p.supply_pa = rig_value(folder, "supply_pressure_pa");
    p.ambient_k = rig_value(folder, "ambient_temperature_k");
    p.ambient_pa = rig_value(folder, "atmospheric_pressure_pa");
    p.charging_w_per_m2_k = rig_value(folder, "heat_transfer_charging_w_per_m2_k");
    p.discharging_w_per_m2_k = rig_value(folder, "heat_transfer_discharging_w_per_m2_k");
    return p;
}

/* One column; returns the number of rows. */
static int read_column(const char *folder, const char *name, const char *wanted, double **values) {
    FILE *file = open_file(folder, name);
    char line[4096], *rest = NULL, *cell;
    int column = -1, rows = 0, room = 1024;
    require(fgets(line, sizeof line, file) != NULL, "empty file");
    rest = line;
    for (int i = 0; (cell = strsep(&rest, ",\r\n")) != NULL; i++) {
        if (!strcmp(cell, wanted)) column = i;
    }
    require(column >= 0, wanted);
    *values = malloc(room * sizeof **values);
    while (fgets(line, sizeof line, file)) {
        rest = line;
        for (int i = 0; i < column; i++) strsep(&rest, ",");
        if (rows == room) *values = realloc(*values, (room *= 2) * sizeof **values);
        (*values)[rows++] = strtod(rest ? rest : "nan", NULL);
    }
    fclose(file);
    return rows;
}

static Case read_case(const char *folder) {
    Case c;
    c.rows = read_column(folder, "expected.csv", "time_s", &c.time_s);
    require(read_column(folder, "drive.csv", "pressure_ref_pa", &c.reference_pa) == c.rows &&
                read_column(folder, "expected.csv", "contraction", &c.contraction) == c.rows &&
                read_column(folder, "expected.csv", "pressure_pa", &c.pressure_pa) == c.rows,
            "drive.csv and expected.csv have different rows");
    return c;
}

/* Measurement -------------------------------------------------------------------------------- */

static double now_seconds(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

static int ascending(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Largest deviation, relative to the expected values' range. */
static double error(const double *values, const double *expected, int rows) {
    double worst = 0.0, low = expected[0], high = expected[0];
    for (int row = 0; row < rows; row++) {
        worst = fmax(worst, fabs(values[row] - expected[row]));
        low = fmin(low, expected[row]);
        high = fmax(high, expected[row]);
    }
    return worst / (high - low);
}

static void measure(const char *name, const Solver *solver, Plant *p, const Case *c,
                    N_Vector state, double tolerance, int repeats) {
    double *contraction = malloc(c->rows * sizeof *contraction);
    double *pressure_pa = malloc(c->rows * sizeof *pressure_pa);
    double *seconds = malloc(repeats * sizeof *seconds);
    int events = 0;
    for (int i = 0; i < repeats; i++) {
        double start_s = now_seconds();
        events = simulate(solver, p, c, state, contraction, pressure_pa);
        seconds[i] = now_seconds() - start_s;
    }
    qsort(seconds, repeats, sizeof *seconds, ascending);
    printf("{\"solver\":\"%s %d.%d.%d\",\"language\":\"C\",\"tolerance\":%.0e,"
           "\"seconds\":%.6g,\"simulated_s\":%.6g,\"error_contraction\":%.3e,"
           "\"error_pressure\":%.3e,\"events\":%d}\n",
           name, SUNDIALS_VERSION_MAJOR, SUNDIALS_VERSION_MINOR, SUNDIALS_VERSION_PATCH,
           tolerance, 0.5 * (seconds[(repeats - 1) / 2] + seconds[repeats / 2]),
           c->time_s[c->rows - 1] - c->time_s[0], error(contraction, c->contraction, c->rows),
           error(pressure_pa, c->pressure_pa, c->rows), events);
    fflush(stdout);
    free(contraction), free(pressure_pa), free(seconds);
}

int main(int count, char **arguments) {
    const char *folder = NULL;
    int repeats = 5;
    for (int i = 1; i < count; i++) {
        if (!strcmp(arguments[i], "--repeats") && i + 1 < count) {
            repeats = atoi(arguments[++i]);
        } else {
            folder = arguments[i];
        }
    }
    require(folder && repeats > 0, "usage: cvode CASE_FOLDER [--repeats N]");

    Plant plant = read_rig(folder);
    Case measured = read_case(folder);
    SUNContext context;
    require(SUNContext_Create(NULL, &context) == 0, "SUNContext_Create");
    N_Vector state = N_VNew_Serial(STATES, context), absolute = N_VClone(state);
    for (size_t i = 0; i < sizeof TOLERANCES / sizeof *TOLERANCES; i++) {
        double tolerance = TOLERANCES[i];
        for (int j = 0; j < STATES; j++) NV_Ith_S(absolute, j) = RANGES[j] * tolerance;
        N_VConst(1.0, state); /* anything valid until the run's start */
        const struct {
            const char *name;
            Solver solver;
        } peers[] = {
            {"SUNDIALS CVODE BDF",
             cvode(CV_BDF, &plant, tolerance, state, absolute, context)},
            {"SUNDIALS CVODE Adams",
             cvode(CV_ADAMS, &plant, tolerance, state, absolute, context)},
            {"SUNDIALS ARKODE ERK 5", erk(&plant, tolerance, state, absolute, context)},
        };
        for (size_t j = 0; j < sizeof peers / sizeof *peers; j++) {
            measure(peers[j].name, &peers[j].solver, &plant, &measured, state, tolerance, repeats);
        }
    }
    return 0;
}
