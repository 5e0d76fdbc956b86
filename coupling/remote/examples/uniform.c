/* A complete fluid solver in C, to copy: a uniform stream against gravity, with hydrostatic pressure, that a fluid at
 * rest follows within a time. Grains make it faster where they leave less room. In a clone of the repository:
 *
 *     cc -std=c99 -O2 coupling/remote/examples/uniform.c -o uniform
 *     voidage run bubbling-bed-quick --fluid attach:tcp:127.0.0.1:4000 & ./uniform tcp:127.0.0.1:4000
 */
#include "../voidage.h"

#define STREAM 0.1 /* m/s, over the whole section */
#define RISE 0.05  /* s, in which the fluid follows */

static voidage_fields accepted; /* where every solution starts */
static voidage_solution next;   /* the last solution, which may be accepted or not */

/* Takes a mesh and accepted fields: at the start, and where the domain gets another mesh. */
static int set_mesh(voidage_run *run)
{
    voidage_mesh mesh;
    double density = voidage_json_number(run->setup, "properties.density", 0.0);
    double x = voidage_json_number(run->setup, "properties.gravity.0", 0.0);
    double y = voidage_json_number(run->setup, "properties.gravity.1", 0.0);
    uint64_t i;
    if (voidage_read_mesh(run, &mesh) < 0) return -1;
    if (mesh.masters != NULL) return voidage_wrong(run, "this solver knows no periodic sides");
    /* The mesh lies in memory of the run until the next request: what is needed later is copied. */
    if (voidage_keep(run, &accepted, &mesh.fields) < 0) return -1;
    if (voidage_keep(run, &next.fields, &mesh.fields) < 0) return -1;
    for (i = 0; i < mesh.nodes; i++) {
        next.fields.pressure[i] = density * (x * mesh.points[2 * i] + y * mesh.points[2 * i + 1]);
    }
    return voidage_done(run);
}

/* Takes other accepted fields on the same mesh: at a restart. */
static int set_state(voidage_run *run)
{
    voidage_fields fields;
    if (voidage_read_state(run, &fields) < 0 || voidage_keep(run, &accepted, &fields) < 0) return -1;
    return voidage_done(run);
}

/* Solves a step from the accepted fields: your equations go here. Where a run rejects a solution, it asks again. */
static int solve(voidage_run *run)
{
    voidage_step step;
    uint64_t i;
    if (voidage_read_step(run, &step) < 0) return -1;
    if (step.accept && voidage_keep(run, &accepted, &next.fields) < 0) return -1;
    for (i = 0; i < accepted.nodes; i++) {
        double share = step.dt / RISE, stream = step.immersed ? STREAM / step.voidage[i] : STREAM;
        next.fields.velocity[2 * i] = accepted.velocity[2 * i] / (1.0 + share);
        next.fields.velocity[2 * i + 1] = (accepted.velocity[2 * i + 1] + share * stream) / (1.0 + share);
    }
    for (i = 0; i < accepted.scalars; i++) {
        memcpy(next.fields.scalar[i], accepted.scalar[i], accepted.nodes * sizeof(double));
    }
    return voidage_answer(run, &next);
}

int main(int count, char **words)
{
    voidage_run run;
    int done = voidage_connect(&run, count == 2 ? words[1] : "", "uniform", NULL, 60.0);
    if (done >= 0) done = voidage_serve(&run, set_mesh, set_state, solve);
    if (done < 0) fprintf(stderr, "uniform: %s\n", run.error);
    voidage_close(&run);
    return done < 0;
}
