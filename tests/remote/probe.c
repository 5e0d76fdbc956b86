/* A solver for the tests: it writes the bits of all that it reads, and answers with the accepted fields, numbers that
 * count up for the balances, for one body and for the report. */
#include "../../coupling/remote/voidage.h"

static voidage_solution answer;
static double numbers[4096];

static void print(const char *name, const double *values, uint64_t count)
{
    uint64_t i, bits;
    if (values == NULL) return;
    printf("%s", name);
    for (i = 0; i < count; i++) {
        memcpy(&bits, &values[i], sizeof bits);
        printf(" %llx", (unsigned long long)bits);
    }
    printf("\n");
}

static void print_fields(const voidage_fields *fields)
{
    uint64_t k;
    print("velocity", fields->velocity, fields->nodes * fields->dimension);
    print("pressure", fields->pressure, fields->nodes);
    for (k = 0; k < fields->scalars; k++) print("value", fields->scalar[k], fields->nodes);
}

static int set_mesh(voidage_run *run)
{
    voidage_mesh mesh;
    uint64_t d = run->dimension;
    if (voidage_read_mesh(run, &mesh) < 0) return -1;
    print("points", mesh.points, mesh.nodes * d);
    print("corners", mesh.corners, mesh.cells * (d + 1));
    print("sides", mesh.sides, mesh.facets * d);
    print("behind", mesh.behind, mesh.facets);
    print("period", mesh.period, d);
    print("masters", mesh.masters, mesh.nodes);
    print_fields(&mesh.fields);
    printf("%s\n", mesh.parts);
    printf("left: %d, right: %d\n", voidage_json_is(mesh.parts, "0.0", "left"),
           voidage_json_is(mesh.parts, "1.0", "right"));
    return voidage_keep(run, &answer.fields, &mesh.fields) < 0 ? -1 : voidage_done(run);
}

static int set_state(voidage_run *run)
{
    voidage_fields fields;
    if (voidage_read_state(run, &fields) < 0) return -1;
    print_fields(&fields);
    return voidage_keep(run, &answer.fields, &fields) < 0 ? -1 : voidage_done(run);
}

static int solve(voidage_run *run)
{
    voidage_step step;
    uint64_t k, rows, d = run->dimension;
    if (voidage_read_step(run, &step) < 0) return -1;
    printf("step %llu.%u accept %d\n", (unsigned long long)step.number, (unsigned)step.iteration, step.accept);
    print("time", &step.time, 1);
    print("dt", &step.dt, 1);
    rows = step.points.rows;
    print("cell", step.points.cell, rows);
    print("coordinate", step.points.coordinate, rows * d);
    print("volume", step.points.volume, rows);
    print("drag", step.points.drag, rows);
    print("mobility", step.points.mobility, rows);
    print("velocity", step.points.velocity, rows * d);
    print("flux_mobility", step.points.flux_mobility, rows);
    print("flux_velocity", step.points.flux_velocity, rows * d);
    for (k = 0; k < run->scalars; k++) {
        print("coefficient", step.points.scalar[k].coefficient, rows);
        print("mobility", step.points.scalar[k].mobility, rows);
        print("value", step.points.scalar[k].value, rows);
    }
    print("voidage", step.voidage, run->nodes);
    print("source", step.source, run->nodes);
    print("places", step.places, run->nodes * d);
    print("motion", step.motion, run->nodes * d);
    if (step.conditions != NULL) printf("%s\n", step.conditions);
    if (voidage_heartbeat(run) < 0) return -1;
    return voidage_answer(run, &answer);
}

int main(int count, char **words)
{
    voidage_run run;
    uint64_t i;
    /* The token has what JSON must escape. */
    int done = voidage_connect(&run, count == 2 ? words[1] : "", "a \"probe\"", "a \\ \"word\"\t", 20.0);
    for (i = 0; i < 4096; i++) numbers[i] = (double)(i + 1);
    if (done >= 0) {
        answer.parts = voidage_json_count(run.setup, "conditions");
        answer.balances = numbers;
        answer.bodies = numbers;
        answer.body_count = 1;
        memcpy(answer.report, numbers, sizeof answer.report);
        printf("%llu parts, density %.17g, %s\n", (unsigned long long)answer.parts,
               voidage_json_number(run.setup, "properties.density", 0.0),
               voidage_json_is(run.setup, "conditions.0.flow", "slip") ? "slip" : "no slip");
        done = voidage_serve(&run, set_mesh, set_state, solve);
    }
    if (done < 0) fprintf(stderr, "probe: %s\n", run.error);
    voidage_close(&run);
    free(answer.fields.memory);
    return done < 0;
}
