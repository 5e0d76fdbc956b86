/* voidage.h: what a fluid solver in C or C++ needs to solve the fluid of a run of voidage, over TCP.
 *
 * Written by `cargo run -p voidage-remote --example header` from coupling/remote/src; do not edit it.
 *
 * The run asks, the solver answers each request (examples/uniform.c is a whole solver):
 *
 *     voidage_connect(&run, "tcp:HOST:PORT", "name", NULL, 60.0)   greets, and gets run.setup, a JSON text
 *     voidage_serve(&run, set_mesh, set_state, solve)              answers by these functions until the end:
 *         set_mesh     voidage_read_mesh, then voidage_done        a mesh and accepted fields
 *         set_state    voidage_read_state, then voidage_done       other accepted fields on this mesh
 *         solve        voidage_read_step, then voidage_answer      one solution, from the accepted fields
 *     voidage_close(&run)
 *
 * A run may ask for many solutions of a step. Each starts from the accepted fields; `accept` in a step says that the
 * solution before it is accepted. A function that returns -1 has written to run.error why; voidage_fail tells the run.
 * What a request brings lies in memory of the run until the next voidage_receive. All numbers are in SI units, those
 * of a vector side by side, in the plane per metre of depth.
 *
 * A solver that takes long calls voidage_heartbeat now and then: a run takes one that is silent for 60 s
 * (`voidage run --timeout`) for dead. This file needs POSIX; include it before all others.
 */
#ifndef VOIDAGE_H
#define VOIDAGE_H

#ifndef _POSIX_C_SOURCE
#define _POSIX_C_SOURCE 200809L
#endif

#include <errno.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#ifndef MSG_NOSIGNAL
#error "voidage.h: include it before all other headers, or define _POSIX_C_SOURCE as 200809L"
#endif

/* ------------------------------------------------------------------------------------------ the protocol */

/* first in every frame; other bytes if the run has another byte order */
#define VOIDAGE_MAGIC UINT64_C(0x2e45474144494f56)
#define VOIDAGE_VERSION 6u /* of the protocol; both ends must have the same */
#define VOIDAGE_PAD 8u /* columns are as long as a multiple of it */
#define VOIDAGE_SCALARS 32 /* that a fluid can carry at most */
#define VOIDAGE_TOKEN "VOIDAGE_TOKEN" /* the environment variable with the token */
#define VOIDAGE_LONGEST_GREETING 512 /* payload with which a solver presents itself, numbers */
#define VOIDAGE_LONGEST_SETUP 8388608u /* payload of the answer, numbers */

/* What a frame is, and what it says. */
enum voidage_kind {
    VOIDAGE_HELLO = 1, /* The fluid presents itself; the grains answer with all that does not change: text */
    VOIDAGE_MESH = 2, /* Mesh and accepted fields; answered by a frame of the same kind without content */
    VOIDAGE_STATE = 3, /* Accepted fields on the mesh there is; answered likewise */
    /* Point terms and voidage for one solution from the accepted state; the text has the conditions if they
     * changed */
    VOIDAGE_STEP = 4,
    VOIDAGE_SOLUTION = 5, /* Answer to a step: nodal fields, what passed the boundary, and a report */
    VOIDAGE_HEARTBEAT = 7, /* The fluid is alive and not done */
    VOIDAGE_ERROR = 8, /* The fluid could not do what was asked: text */
    VOIDAGE_BYE = 9 /* The grains are done */
};

/* Flags of a frame. */
enum voidage_flag {
    VOIDAGE_ACCEPT = 1, /* Flag of a step or a state: the last solution is accepted, before anything else is done */
    /* Flag of a step: the mesh moves, and the payload has the places and velocities of its nodes */
    VOIDAGE_MOVES = 2,
    VOIDAGE_IMMERSED = 4, /* Flag of a step: there are grains, and the payload has point terms and voidage */
    /* Flag of a step with grains: solid volume comes in, and the payload has the nodal source of the equation of
     * mass behind the voidage */
    VOIDAGE_APPEARS = 8,
    /* Flag of a mesh: it has periodic sides, and the payload has the lengths of the period and the master of every
     * node behind the cells of the facets */
    VOIDAGE_JOINED = 16
};

/* The header of a frame. A payload follows, of `length` numbers of 8 bytes. */
typedef struct {
    uint64_t magic; /* VOIDAGE_MAGIC */
    uint32_t version; /* VOIDAGE_VERSION */
    uint32_t kind; /* A voidage_kind */
    uint64_t run; /* Number of the run; 0 before the grains have answered the hello */
    uint32_t generation; /* Number of the mesh, from 1; 0 before the first */
    uint32_t flags; /* VOIDAGE_ACCEPT, VOIDAGE_MOVES, VOIDAGE_IMMERSED, VOIDAGE_APPEARS and VOIDAGE_JOINED, or 0 */
    uint64_t step; /* Number of the step since time zero; the first is 1 */
    uint32_t iteration; /* How many solutions of this step went before */
    uint32_t scalars; /* Which scalars have columns, one bit each */
    double time; /* Time at the start of the step, s */
    double dt; /* Length of the step; in an answer the wall time that the fluid took for it, s */
    uint64_t rows; /* Rows of the columns: points, or nodes of the mesh */
    uint64_t stride; /* Distance from column to column in numbers; at least `rows` */
    uint64_t cells; /* Cells of a mesh; else 0 */
    uint64_t facets; /* Facets of the boundary of a mesh; else 0 */
    uint64_t parts; /* Parts of the boundary whose balances a solution has; else 0 */
    /* Nodes of which a step brings the voidage (with grains) or the motion (if the mesh moves); else 0 */
    uint64_t nodes;
    uint64_t text; /* Bytes of the text at the end of the payload */
    uint64_t length; /* Numbers in the payload */
} voidage_header;

/* If the compiler places a field elsewhere than the run, there is an array of -1 elements here. */
typedef char voidage_check_magic[offsetof(voidage_header, magic) == 0 ? 1 : -1];
typedef char voidage_check_version[offsetof(voidage_header, version) == 8 ? 1 : -1];
typedef char voidage_check_kind[offsetof(voidage_header, kind) == 12 ? 1 : -1];
typedef char voidage_check_run[offsetof(voidage_header, run) == 16 ? 1 : -1];
typedef char voidage_check_generation[offsetof(voidage_header, generation) == 24 ? 1 : -1];
typedef char voidage_check_flags[offsetof(voidage_header, flags) == 28 ? 1 : -1];
typedef char voidage_check_step[offsetof(voidage_header, step) == 32 ? 1 : -1];
typedef char voidage_check_iteration[offsetof(voidage_header, iteration) == 40 ? 1 : -1];
typedef char voidage_check_scalars[offsetof(voidage_header, scalars) == 44 ? 1 : -1];
typedef char voidage_check_time[offsetof(voidage_header, time) == 48 ? 1 : -1];
typedef char voidage_check_dt[offsetof(voidage_header, dt) == 56 ? 1 : -1];
typedef char voidage_check_rows[offsetof(voidage_header, rows) == 64 ? 1 : -1];
typedef char voidage_check_stride[offsetof(voidage_header, stride) == 72 ? 1 : -1];
typedef char voidage_check_cells[offsetof(voidage_header, cells) == 80 ? 1 : -1];
typedef char voidage_check_facets[offsetof(voidage_header, facets) == 88 ? 1 : -1];
typedef char voidage_check_parts[offsetof(voidage_header, parts) == 96 ? 1 : -1];
typedef char voidage_check_nodes[offsetof(voidage_header, nodes) == 104 ? 1 : -1];
typedef char voidage_check_text[offsetof(voidage_header, text) == 112 ? 1 : -1];
typedef char voidage_check_length[offsetof(voidage_header, length) == 120 ? 1 : -1];
typedef char voidage_check_size[sizeof(voidage_header) == 128 ? 1 : -1];

/* The name of a kind; NULL if there is no such kind. */
static inline const char *voidage_kind_name(uint32_t kind)
{
    switch (kind) {
    case VOIDAGE_HELLO: return "hello";
    case VOIDAGE_MESH: return "mesh";
    case VOIDAGE_STATE: return "state";
    case VOIDAGE_STEP: return "step";
    case VOIDAGE_SOLUTION: return "solution";
    case VOIDAGE_HEARTBEAT: return "heartbeat";
    case VOIDAGE_ERROR: return "error";
    case VOIDAGE_BYE: return "bye";
    default: return NULL;
    }
}

/* -------------------------------------------------------------------------------- what requests bring and take */

/* Nodal fields. A solver may change what it points to. */
typedef struct {
    uint64_t nodes;
    uint64_t dimension;
    uint64_t scalars; /* how many there are */
    double *velocity; /* nodes x dimension, m/s */
    double *pressure; /* nodes, Pa */
    double *scalar[VOIDAGE_SCALARS]; /* nodes, K for heat, of each of them */
    double *memory; /* what voidage_keep has allocated; `free` it */
} voidage_fields;

/* Point terms: what is in the fluid, seen from the fluid. The law of the velocity that a point will have is
 *     velocity + mobility * (drag * u - volume * grad(p)),
 *     in the equation of mass flux_velocity + flux_mobility * (drag * u - volume * grad(p))
 *     value + mobility * coefficient * s
 */
typedef struct {
    uint64_t rows;
    double *cell; /* rows, whole numbers: its cell of the mesh */
    double *coordinate; /* rows x dimension */
    double *volume; /* rows, m^D */
    double *drag; /* rows, kg/s */
    double *mobility; /* rows, s/kg */
    double *velocity; /* rows x dimension, m/s */
    double *flux_mobility; /* rows, s/kg */
    double *flux_velocity; /* rows x dimension, m/s */
    struct {
        double *coefficient; /* rows, W/K */
        double *mobility; /* rows, K/W */
        double *value; /* rows, K */
    } scalar[VOIDAGE_SCALARS]; /* of each scalar of the fluid; NULL for one that the points do not exchange */
} voidage_points;

/* A mesh of triangles (of tetrahedra in space). */
typedef struct {
    uint64_t nodes;
    uint64_t cells;
    uint64_t facets;
    double *points; /* nodes x dimension, m: places of the nodes */
    double *corners; /* cells x (dimension + 1), whole numbers: nodes of each cell */
    double *sides; /* facets x dimension, whole numbers: nodes of each facet of the boundary, part by part */
    double *behind; /* facets, whole numbers: the cell behind each facet */
    /* 1 x dimension, m: lengths of the period; 0 along an axis without; NULL without VOIDAGE_JOINED */
    double *period;
    /* nodes, whole numbers: the node whose values each node has; mostly itself; NULL without VOIDAGE_JOINED */
    double *masters;
    voidage_fields fields; /* the accepted fields */
    const char *parts;     /* names of the parts of the boundary and their numbers of facets, [["left", 12], ..] */
} voidage_mesh;

/* A step, to be solved from the accepted fields. */
typedef struct {
    int accept;         /* whether the solution before is accepted, before anything else is done */
    uint64_t number;    /* since time zero; the first is 1 */
    uint32_t iteration; /* how many solutions of this step went before */
    double time;        /* at its start, s */
    double dt;          /* its length, s */
    int immersed;       /* whether there are points */
    voidage_points points;
    double *voidage; /* nodes: share of fluid at the nodes; NULL without VOIDAGE_IMMERSED */
    /* nodes, 1/s: right-hand side of the equation of mass at the nodes; NULL without VOIDAGE_APPEARS */
    double *source;
    double *places; /* nodes x dimension, m: where the nodes are at the end of the step; NULL without VOIDAGE_MOVES */
    double *motion; /* nodes x dimension, m/s: velocity of the nodes in the step; NULL without VOIDAGE_MOVES */
    const char *conditions; /* on the boundary, JSON, if they are new; else NULL. Those of the setup are the first */
} voidage_step;

/* Numbers of the balance of a part of the boundary:
 *     flux (1; m^D/s): volume that leaves through the part
 *     force (dimension; N): force of the fluid on the part
 *     torque (dimension * (dimension - 1) / 2; N m): moment of this force about the origin
 *     scalars (scalars; W): what the part gives to the fluid of each scalar by conduction and transfer
 *     convected (scalars; W): what the fluid carries out through the part of each scalar
 */
#define VOIDAGE_BALANCE_NUMBERS(dimension, scalars) \
    (1 + (dimension) + (dimension) * ((dimension) - 1) / 2 + (scalars) + (scalars))

/* Numbers that answer for a body (a part of the boundary that moves in the fluid):
 *     velocity (dimension; m/s): its velocity at the end of the step
 *     vapour (1; m^D/s): volume of vapour that leaves it
 */
#define VOIDAGE_BODY_NUMBERS(dimension) ((dimension) + 1)

/* Numbers of a report. */
enum voidage_report {
    VOIDAGE_REPORT_FLOW_ITERATIONS = 0, /* iterations of the flow */
    VOIDAGE_REPORT_SCALAR_ITERATIONS = 1, /* iterations of the scalars */
    VOIDAGE_REPORT_RESIDUAL = 2, /* relative residual of the flow at the end */
    VOIDAGE_REPORT_FACTORED = 3, /* 1 if a matrix was factored, else 0 */
    VOIDAGE_REPORT_SCALARS_S = 4, /* wall time of the scalars, s */
    VOIDAGE_REPORT_FLOW_S = 5, /* wall time of the flow, s */
    VOIDAGE_REPORT_NUMBERS = 6
};

/* What a solver answers to a step. All zero but for the fields is a whole answer. */
typedef struct {
    voidage_fields fields;  /* at the end of the step */
    const double *balances; /* of each part, in the order of the conditions; NULL if the solver does not know */
    uint64_t parts;         /* how many balances there are */
    const double *bodies;   /* of each body, in the order of the conditions */
    uint64_t body_count;
    double report[VOIDAGE_REPORT_NUMBERS];
} voidage_solution;

/* The run that a solver works for. */
typedef struct {
    const char *setup;      /* properties, scalars, numerics and conditions, JSON: see voidage_json */
    uint64_t dimension;     /* 2, or 3 */
    uint64_t scalars;       /* that the fluid carries */
    uint64_t nodes, cells;  /* of the mesh; 0 before the first */
    voidage_header request; /* the header of the frame that came last */
    char error[1024];       /* why a function returned -1 */
    double *payload;        /* from here on for the functions below */
    double *answer;
    size_t payload_room, answer_room;
    double patience, arrived;
    uint64_t number;
    int socket;
} voidage_run;

/* What is left of a payload. */
typedef struct {
    double *at;
    uint64_t left;
} voidage_rest;

/* Notes what is wrong, and returns -1. */
#ifdef __GNUC__
__attribute__((format(printf, 2, 3)))
#endif
static inline int voidage_wrong(voidage_run *run, const char *format, ...)
{
    va_list words;
    va_start(words, format);
    vsnprintf(run->error, sizeof run->error, format, words);
    va_end(words);
    return -1;
}

/* ---------------------------------------------------------------------------------------------------- JSON */

static inline const char *voidage_json_space(const char *at)
{
    while (*at == ' ' || *at == '\t' || *at == '\n' || *at == '\r') at++;
    return at;
}

/* The comma, colon or bracket behind a value; the end of the text if there is none. */
static inline const char *voidage_json_skip(const char *at)
{
    int depth = 0, quoted = 0;
    for (; *at != 0; at++) {
        if (quoted) {
            if (*at == '\\' && at[1] != 0) at++;
            else if (*at == '"') quoted = 0;
        } else if (*at == '"') {
            quoted = 1;
        } else if (*at == '{' || *at == '[') {
            depth++;
        } else if (depth == 0 && (*at == ',' || *at == ':' || *at == '}' || *at == ']')) {
            return at;
        } else if (*at == '}' || *at == ']') {
            depth--;
        }
    }
    return at;
}

/* The value at a path such as "properties.gravity.1" (names, and numbers from 0); NULL if there is none. */
static inline const char *voidage_json(const char *at, const char *path)
{
    if (at == NULL) return NULL;
    at = voidage_json_space(at);
    while (*path != 0) {
        size_t length = strcspn(path, ".");
        int list = *at == '[', found = 0;
        unsigned long index = list ? strtoul(path, NULL, 10) : 0;
        if (!list && *at != '{') return NULL;
        at = voidage_json_space(at + 1);
        while (!found) {
            if (*at == 0 || *at == '}' || *at == ']') return NULL;
            if (list) {
                found = index-- == 0;
            } else {
                found = *at == '"' && strncmp(at + 1, path, length) == 0 && at[1 + length] == '"';
                at = voidage_json_skip(at);
                if (*at != ':') return NULL;
                at = voidage_json_space(at + 1);
            }
            if (found) break;
            at = voidage_json_skip(at);
            if (*at != ',') return NULL;
            at = voidage_json_space(at + 1);
        }
        path += length;
        if (*path == '.') path++;
    }
    return at;
}

/* The number at a path; `otherwise` if there is none. */
static inline double voidage_json_number(const char *json, const char *path, double otherwise)
{
    char *end;
    const char *at = voidage_json(json, path);
    double number = at == NULL ? 0.0 : strtod(at, &end);
    return at == NULL || end == at ? otherwise : number;
}

/* How many items the list at a path has; 0 if there is no list. */
static inline uint64_t voidage_json_count(const char *json, const char *path)
{
    uint64_t count = 0;
    const char *at = voidage_json(json, path);
    if (at == NULL || *at != '[') return 0;
    for (at = voidage_json_space(at + 1); *at != 0 && *at != ']'; count++) {
        at = voidage_json_skip(at);
        if (*at == ',') at++;
        else if (*at != ']') return 0;
    }
    return count;
}

/* Whether the value at a path is this word. Of a condition with numbers, {"open": ..}, voidage_json finds "open". */
static inline int voidage_json_is(const char *json, const char *path, const char *word)
{
    const char *at = voidage_json(json, path);
    size_t length = strlen(word);
    return at != NULL && *at == '"' && strncmp(at + 1, word, length) == 0 && at[1 + length] == '"';
}

/* ------------------------------------------------------------------------------------------------ the socket */

static inline double voidage_clock(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static inline int voidage_send_bytes(voidage_run *run, const void *from, size_t bytes)
{
    size_t done = 0;
    while (done < bytes) {
        ssize_t sent = send(run->socket, (const char *)from + done, bytes - done, MSG_NOSIGNAL);
        if (sent > 0) {
            done += (size_t)sent;
        } else if (sent < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
            return voidage_wrong(run, "the run has taken nothing of a frame for %g s", run->patience);
        } else if (sent == 0 || errno != EINTR) {
            return voidage_wrong(run, "the run is gone: it was killed, or the connection broke");
        }
    }
    return 0;
}

static inline int voidage_receive_bytes(voidage_run *run, void *to, size_t bytes, int begun, const char *of)
{
    size_t done = 0;
    while (done < bytes) {
        ssize_t got = recv(run->socket, (char *)to + done, bytes - done, 0);
        int began = begun || done > 0;
        if (got > 0) {
            done += (size_t)got;
        } else if (got < 0 && errno == EINTR) {
            continue;
        } else if (got < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
            if (began) return voidage_wrong(run, "a frame of which nothing has come for %g s", run->patience);
            if (run->number == 0) return voidage_wrong(run, "no answer to the hello in %g s", run->patience);
        } else if (began) {
            return voidage_wrong(run, "the connection ended within a frame, after %llu of the %llu bytes of its %s",
                                 (unsigned long long)done, (unsigned long long)bytes, of);
        } else if (run->number == 0) {
            return voidage_wrong(run, "the run takes no solver with this token and of this version of the protocol "
                                 "(%u): give both the same word in " VOIDAGE_TOKEN ", and compile the solver with "
                                 "the voidage.h of the run", (unsigned)VOIDAGE_VERSION);
        } else {
            return voidage_wrong(run, "the run is gone: it was killed, or the connection broke");
        }
    }
    return 0;
}

/* Makes room for so many numbers. */
static inline int voidage_make_room(voidage_run *run, double **numbers, size_t *room, uint64_t count)
{
    void *more;
    if (count < *room) return 0;
    more = count < SIZE_MAX / sizeof(double) - 1 ? realloc(*numbers, ((size_t)count + 1) * sizeof(double)) : NULL;
    if (more == NULL) {
        return voidage_wrong(run, "there is no memory for a frame of %llu numbers", (unsigned long long)count);
    }
    *numbers = (double *)more;
    *room = (size_t)count + 1;
    return 0;
}

/* Receives a frame and checks that it is one. */
static inline int voidage_receive_frame(voidage_run *run)
{
    voidage_header *frame = &run->request;
    uint64_t text;
    if (voidage_receive_bytes(run, frame, sizeof *frame, 0, "header") < 0) return -1;
    if (frame->magic != VOIDAGE_MAGIC) {
        return voidage_wrong(run, "a frame starts with %#018llx and not with %#018llx",
                             (unsigned long long)frame->magic, (unsigned long long)VOIDAGE_MAGIC);
    }
    if (frame->version != VOIDAGE_VERSION) {
        return voidage_wrong(run, "a frame of protocol version %u, this is version %u: compile the solver with the "
                             "voidage.h of the run", (unsigned)frame->version, (unsigned)VOIDAGE_VERSION);
    }
    if (voidage_kind_name(frame->kind) == NULL) {
        return voidage_wrong(run, "a frame of the unknown kind %u", (unsigned)frame->kind);
    }
    if (run->number == 0 && frame->length > VOIDAGE_LONGEST_SETUP) {
        return voidage_wrong(run, "a hello that says it has %llu numbers", (unsigned long long)frame->length);
    }
    if (run->number != 0 && frame->run != run->number) {
        return voidage_wrong(run, "a frame of the run %llx", (unsigned long long)frame->run);
    }
    text = frame->text / 8 + (frame->text % 8 != 0);
    if (text > frame->length) {
        return voidage_wrong(run, "a text of %llu bytes in %llu numbers", (unsigned long long)frame->text,
                             (unsigned long long)frame->length);
    }
    if (voidage_make_room(run, &run->payload, &run->payload_room, frame->length) < 0) return -1;
    if (voidage_receive_bytes(run, run->payload, (size_t)frame->length * 8, 1, "payload") < 0) return -1;
    /* There is room for one number more, so that every text can end with a zero. */
    ((char *)(run->payload + (frame->length - text)))[frame->text] = 0;
    return 0;
}

/* The text at the end of the payload. */
static inline const char *voidage_text(const voidage_run *run)
{
    uint64_t text = run->request.text / 8 + (run->request.text % 8 != 0);
    return (const char *)(run->payload + (run->request.length - text));
}

/* Sends a frame of so many numbers, which repeats what the request says. */
static inline int voidage_send_frame(voidage_run *run, voidage_header frame, const double *numbers)
{
    frame.magic = VOIDAGE_MAGIC;
    frame.version = VOIDAGE_VERSION;
    frame.run = run->number;
    frame.generation = run->request.generation;
    frame.step = run->request.step;
    frame.iteration = run->request.iteration;
    frame.time = run->request.time;
    frame.dt = voidage_clock() - run->arrived;
    if (voidage_send_bytes(run, &frame, sizeof frame) < 0) return -1;
    return voidage_send_bytes(run, numbers, (size_t)frame.length * 8);
}

static inline voidage_header voidage_empty(uint32_t kind)
{
    voidage_header header;
    memset(&header, 0, sizeof header);
    header.kind = kind;
    return header;
}

static inline int voidage_send_text(voidage_run *run, uint32_t kind, const char *text)
{
    voidage_header frame = voidage_empty(kind);
    frame.text = strlen(text);
    frame.length = frame.text / 8 + (frame.text % 8 != 0);
    if (voidage_make_room(run, &run->answer, &run->answer_room, frame.length) < 0) return -1;
    memset(run->answer, 0, ((size_t)frame.length + 1) * 8);
    memcpy(run->answer, text, (size_t)frame.text);
    return voidage_send_frame(run, frame, run->answer);
}

/* Writes a text as JSON does, with its quotes; returns where it ends, NULL if there is no room. */
static inline char *voidage_quote(char *to, const char *end, const char *text)
{
    if (end - to < 3) return NULL;
    *to++ = '"';
    for (; *text != 0; text++) {
        if (end - to < 9) return NULL;
        if ((unsigned char)*text < 0x20) {
            to += sprintf(to, "\\u%04x", (unsigned)*text);
        } else {
            if (*text == '"' || *text == '\\') *to++ = '\\';
            *to++ = *text;
        }
    }
    *to++ = '"';
    *to = 0;
    return to;
}

/* ------------------------------------------------------------------------------------------- for solvers */

/* Closes the connection and frees the memory of the run. */
static inline void voidage_close(voidage_run *run)
{
    if (run->socket >= 0) close(run->socket);
    free(run->payload);
    free(run->answer);
    free((void *)run->setup);
    memset(run, 0, sizeof *run);
    run->socket = -1;
}

/* A socket at "tcp:HOST:PORT", waiting `patience` seconds for somebody to listen there. */
static inline int voidage_open(voidage_run *run, const char *address)
{
    char host[256], *colon;
    struct addrinfo hints, *places = NULL, *place;
    struct timeval limit;
    struct timespec pause = {0, 20000000L};
    double start = voidage_clock();
    int failed, one = 1;
    if (strncmp(address, "tcp:", 4) != 0 || strlen(address) - 4 >= sizeof host) {
        return voidage_wrong(run, "`%.200s` is no address for this solver; give tcp:HOST:PORT", address);
    }
    strcpy(host, address + 4);
    colon = strrchr(host, ':');
    if (colon == NULL || colon == host || colon[1] == 0) {
        return voidage_wrong(run, "`%.200s` is no address for this solver; give tcp:HOST:PORT", address);
    }
    *colon = 0;
    if (host[0] == '[' && colon[-1] == ']') colon[-1] = 0;
    memset(&hints, 0, sizeof hints);
    hints.ai_socktype = SOCK_STREAM;
    failed = getaddrinfo(host[0] == '[' ? host + 1 : host, colon + 1, &hints, &places);
    if (failed != 0) return voidage_wrong(run, "cannot connect to %.200s: %s", address, gai_strerror(failed));
    for (;;) {
        failed = ECONNREFUSED;
        for (place = places; place != NULL && run->socket < 0; place = place->ai_next) {
            run->socket = socket(place->ai_family, place->ai_socktype, place->ai_protocol);
            if (run->socket >= 0 && connect(run->socket, place->ai_addr, place->ai_addrlen) == 0) break;
            failed = errno;
            if (run->socket >= 0) close(run->socket);
            run->socket = -1;
        }
        if (run->socket >= 0 || failed != ECONNREFUSED || voidage_clock() - start >= run->patience) break;
        nanosleep(&pause, NULL);
    }
    freeaddrinfo(places);
    if (run->socket < 0) return voidage_wrong(run, "cannot connect to %.200s: %s", address, strerror(failed));
    limit.tv_sec = (time_t)run->patience;
    limit.tv_usec = (suseconds_t)(1e6 * (run->patience - (double)limit.tv_sec));
    setsockopt(run->socket, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
    setsockopt(run->socket, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    setsockopt(run->socket, SOL_SOCKET, SO_SNDTIMEO, &limit, sizeof limit);
    return 0;
}

/* Connects to the run at an address, which may take `patience` seconds to be there and to send a frame once it has
 * begun. `solver` is the name to present oneself with, `token` the word that the run asks for (NULL: that of the
 * environment variable VOIDAGE_TOKEN). */
static inline int voidage_connect(voidage_run *run, const char *address, const char *solver, const char *token,
                                  double patience)
{
    char hello[8 * VOIDAGE_LONGEST_GREETING], *end = hello + sizeof hello, *to = hello;
    char *setup;
    memset(run, 0, sizeof *run);
    run->socket = -1;
    run->patience = patience < 0.1 ? 0.1 : patience;
    run->arrived = voidage_clock();
    if (token == NULL) token = getenv(VOIDAGE_TOKEN);
    if (voidage_open(run, address) < 0) return -1;
    to += sprintf(to, "{\"protocol\":%u,\"solver\":", (unsigned)VOIDAGE_VERSION);
    to = voidage_quote(to, end, solver);
    if (to != NULL && token != NULL && token[0] != 0) {
        if (end - to < 16) return voidage_wrong(run, "the name of the solver is too long");
        to += sprintf(to, ",\"token\":");
        to = voidage_quote(to, end, token);
    }
    if (to == NULL || end - to < 2) return voidage_wrong(run, "the name of the solver and its token are too long");
    strcpy(to, "}");
    if (voidage_send_text(run, VOIDAGE_HELLO, hello) < 0) return -1;
    if (voidage_receive_frame(run) < 0) return -1;
    if (run->request.kind != VOIDAGE_HELLO) {
        return voidage_wrong(run, "%s instead of a hello", voidage_kind_name(run->request.kind));
    }
    setup = (char *)malloc((size_t)run->request.text + 1);
    if (setup == NULL) return voidage_wrong(run, "there is no memory for the setup");
    memcpy(setup, voidage_text(run), (size_t)run->request.text + 1);
    run->setup = setup;
    run->number = run->request.run;
    run->dimension = (uint64_t)voidage_json_number(setup, "dimension", 0.0);
    run->scalars = voidage_json_count(setup, "scalars");
    if (run->dimension < 2 || run->dimension > 3 || run->scalars > VOIDAGE_SCALARS || run->number == 0) {
        return voidage_wrong(run, "a setup of %llu dimensions and %llu scalars", (unsigned long long)run->dimension,
                             (unsigned long long)run->scalars);
    }
    return 0;
}

/* Waits for a request and returns its kind, or -1. */
static inline int voidage_receive(voidage_run *run)
{
    do {
        if (voidage_receive_frame(run) < 0) return -1;
    } while (run->request.kind == VOIDAGE_HEARTBEAT);
    run->arrived = voidage_clock();
    switch (run->request.kind) {
    case VOIDAGE_MESH:
    case VOIDAGE_STATE:
    case VOIDAGE_STEP:
    case VOIDAGE_BYE: return (int)run->request.kind;
    default: return voidage_wrong(run, "%s is no request", voidage_kind_name(run->request.kind));
    }
}

/* Answers that a mesh or a state has been taken. */
static inline int voidage_done(voidage_run *run)
{
    return voidage_send_frame(run, voidage_empty(run->request.kind), run->answer);
}

/* Answers that the request cannot be fulfilled, and why: the user will read it. */
static inline int voidage_fail(voidage_run *run, const char *why)
{
    char text[8192];
    snprintf(text, sizeof text, "%s", why);
    return run->socket < 0 ? -1 : voidage_send_text(run, VOIDAGE_ERROR, text);
}

/* Says that the solver is alive and not done; -1 if the run is gone, and nobody waits for the answer. */
static inline int voidage_heartbeat(voidage_run *run)
{
    return voidage_send_frame(run, voidage_empty(VOIDAGE_HEARTBEAT), run->answer);
}

/* -------------------------------------------------------------------------------- what is in a payload */

/* So many rows of `width` numbers each; NULL if they are not there. */
static inline double *voidage_take(voidage_run *run, voidage_rest *rest, uint64_t rows, uint64_t width,
                                   const char *name)
{
    double *at = rest->at;
    if (rows > rest->left / width) {
        voidage_wrong(run, "the %s of a %s: %llu times %llu numbers where %llu are left", name,
                      voidage_kind_name(run->request.kind), (unsigned long long)rows, (unsigned long long)width,
                      (unsigned long long)rest->left);
        return NULL;
    }
    rest->at += rows * width;
    rest->left -= rows * width;
    return at;
}

/* Whether numbers are whole and below a count. */
static inline int voidage_check_whole(voidage_run *run, const double *numbers, uint64_t count, uint64_t below,
                                      const char *name)
{
    uint64_t k;
    for (k = 0; k < count; k++) {
        if (!(numbers[k] >= 0.0 && numbers[k] < (double)below) || (double)(uint64_t)numbers[k] != numbers[k]) {
            return voidage_wrong(run, "the number %g among %s, there are %llu", numbers[k], name,
                                 (unsigned long long)below);
        }
    }
    return 0;
}

/* The payload of the request, without its text; -1 if the columns do not lie as they must. */
static inline int voidage_begin(voidage_run *run, voidage_rest *rest)
{
    const voidage_header *frame = &run->request;
    uint64_t over = frame->rows % VOIDAGE_PAD;
    rest->at = run->payload;
    rest->left = frame->length - (frame->text / 8 + (frame->text % 8 != 0));
    if (frame->rows > frame->length || frame->stride != frame->rows + (over == 0 ? 0 : VOIDAGE_PAD - over)) {
        return voidage_wrong(run, "%llu rows, %llu apart, in %llu numbers", (unsigned long long)frame->rows,
                             (unsigned long long)frame->stride, (unsigned long long)frame->length);
    }
    return 0;
}

/* All of the payload must have been taken. */
static inline int voidage_end(voidage_run *run, const voidage_rest *rest)
{
    if (rest->left == 0) return 0;
    return voidage_wrong(run, "%llu numbers too many in a %s", (unsigned long long)rest->left,
                         voidage_kind_name(run->request.kind));
}

static inline int voidage_take_fields(voidage_run *run, voidage_rest *rest, voidage_fields *fields)
{
    const voidage_header *frame = &run->request;
    uint64_t k;
    if (frame->scalars != (uint32_t)((UINT64_C(1) << run->scalars) - 1)) {
        return voidage_wrong(run, "fields with the scalars %#x, there are %llu", (unsigned)frame->scalars,
                             (unsigned long long)run->scalars);
    }
    fields->nodes = frame->rows;
    fields->dimension = run->dimension;
    fields->scalars = run->scalars;
    fields->velocity = voidage_take(run, rest, frame->stride, run->dimension, "velocity");
    if (fields->velocity == NULL) return -1;
    fields->pressure = voidage_take(run, rest, frame->stride, 1, "pressure");
    if (fields->pressure == NULL) return -1;
    for (k = 0; k < run->scalars; k++) {
        fields->scalar[k] = voidage_take(run, rest, frame->stride, 1, "scalar[k]");
        if (fields->scalar[k] == NULL) return -1;
    }
    return 0;
}

static inline int voidage_take_points(voidage_run *run, voidage_rest *rest, voidage_points *points)
{
    const voidage_header *frame = &run->request;
    uint64_t k;
    if ((uint64_t)frame->scalars >> run->scalars != 0) {
        return voidage_wrong(run, "points with the scalars %#x, there are %llu", (unsigned)frame->scalars,
                             (unsigned long long)run->scalars);
    }
    points->rows = frame->rows;
    points->cell = voidage_take(run, rest, frame->stride, 1, "cell");
    if (points->cell == NULL) return -1;
    if (voidage_check_whole(run, points->cell, frame->rows, run->cells, "cell") < 0) return -1;
    points->coordinate = voidage_take(run, rest, frame->stride, run->dimension, "coordinate");
    if (points->coordinate == NULL) return -1;
    points->volume = voidage_take(run, rest, frame->stride, 1, "volume");
    if (points->volume == NULL) return -1;
    points->drag = voidage_take(run, rest, frame->stride, 1, "drag");
    if (points->drag == NULL) return -1;
    points->mobility = voidage_take(run, rest, frame->stride, 1, "mobility");
    if (points->mobility == NULL) return -1;
    points->velocity = voidage_take(run, rest, frame->stride, run->dimension, "velocity");
    if (points->velocity == NULL) return -1;
    points->flux_mobility = voidage_take(run, rest, frame->stride, 1, "flux_mobility");
    if (points->flux_mobility == NULL) return -1;
    points->flux_velocity = voidage_take(run, rest, frame->stride, run->dimension, "flux_velocity");
    if (points->flux_velocity == NULL) return -1;
    for (k = 0; k < run->scalars; k++) {
        if ((frame->scalars >> k & 1) == 0) continue;
        points->scalar[k].coefficient = voidage_take(run, rest, frame->stride, 1, "coefficient");
        if (points->scalar[k].coefficient == NULL) return -1;
        points->scalar[k].mobility = voidage_take(run, rest, frame->stride, 1, "mobility");
        if (points->scalar[k].mobility == NULL) return -1;
        points->scalar[k].value = voidage_take(run, rest, frame->stride, 1, "value");
        if (points->scalar[k].value == NULL) return -1;
    }
    return 0;
}

/* Reads a mesh and the accepted fields on it. */
static inline int voidage_read_mesh(voidage_run *run, voidage_mesh *mesh)
{
    const voidage_header *frame = &run->request;
    voidage_rest rest;
    memset(mesh, 0, sizeof *mesh);
    if (voidage_begin(run, &rest) < 0) return -1;
    mesh->nodes = frame->rows;
    mesh->cells = frame->cells;
    mesh->facets = frame->facets;
    mesh->points = voidage_take(run, &rest, frame->rows, run->dimension, "points");
    if (mesh->points == NULL) return -1;
    mesh->corners = voidage_take(run, &rest, frame->cells, (run->dimension + 1), "corners");
    if (mesh->corners == NULL) return -1;
    if (voidage_check_whole(run, mesh->corners, frame->cells * (run->dimension + 1), frame->rows, "corners") < 0)
        return -1;
    mesh->sides = voidage_take(run, &rest, frame->facets, run->dimension, "sides");
    if (mesh->sides == NULL) return -1;
    if (voidage_check_whole(run, mesh->sides, frame->facets * run->dimension, frame->rows, "sides") < 0) return -1;
    mesh->behind = voidage_take(run, &rest, frame->facets, 1, "behind");
    if (mesh->behind == NULL) return -1;
    if (voidage_check_whole(run, mesh->behind, frame->facets, frame->cells, "behind") < 0) return -1;
    if ((frame->flags & VOIDAGE_JOINED) != 0) {
        mesh->period = voidage_take(run, &rest, 1, run->dimension, "period");
        if (mesh->period == NULL) return -1;
    }
    if ((frame->flags & VOIDAGE_JOINED) != 0) {
        mesh->masters = voidage_take(run, &rest, frame->rows, 1, "masters");
        if (mesh->masters == NULL) return -1;
        if (voidage_check_whole(run, mesh->masters, frame->rows, frame->rows, "masters") < 0) return -1;
    }
    if (voidage_take_fields(run, &rest, &mesh->fields) < 0 || voidage_end(run, &rest) < 0) return -1;
    mesh->parts = voidage_text(run);
    run->nodes = mesh->nodes;
    run->cells = mesh->cells;
    return 0;
}

/* Reads other accepted fields for the mesh there is. */
static inline int voidage_read_state(voidage_run *run, voidage_fields *fields)
{
    voidage_rest rest;
    memset(fields, 0, sizeof *fields);
    if (voidage_begin(run, &rest) < 0) return -1;
    if (run->nodes == 0 || run->request.rows != run->nodes) {
        return voidage_wrong(run, "fields of %llu nodes, the mesh has %llu", (unsigned long long)run->request.rows,
                             (unsigned long long)run->nodes);
    }
    if (voidage_take_fields(run, &rest, fields) < 0) return -1;
    return voidage_end(run, &rest);
}

/* Reads a step. */
static inline int voidage_read_step(voidage_run *run, voidage_step *step)
{
    const voidage_header *frame = &run->request;
    const uint32_t nodal = VOIDAGE_IMMERSED | VOIDAGE_APPEARS | VOIDAGE_MOVES;
    voidage_rest rest;
    memset(step, 0, sizeof *step);
    if (run->nodes == 0) return voidage_wrong(run, "a step before the mesh");
    if (voidage_begin(run, &rest) < 0) return -1;
    if ((frame->flags & nodal) != 0 && frame->nodes != run->nodes) {
        return voidage_wrong(run, "a step for %llu nodes, the mesh has %llu", (unsigned long long)frame->nodes,
                             (unsigned long long)run->nodes);
    }
    step->accept = (frame->flags & VOIDAGE_ACCEPT) != 0;
    step->number = frame->step;
    step->iteration = frame->iteration;
    step->time = frame->time;
    step->dt = frame->dt;
    step->immersed = (frame->flags & VOIDAGE_IMMERSED) != 0;
    if (step->immersed && voidage_take_points(run, &rest, &step->points) < 0) return -1;
    if ((frame->flags & VOIDAGE_IMMERSED) != 0) {
        step->voidage = voidage_take(run, &rest, frame->nodes, 1, "voidage");
        if (step->voidage == NULL) return -1;
    }
    if ((frame->flags & VOIDAGE_APPEARS) != 0) {
        step->source = voidage_take(run, &rest, frame->nodes, 1, "source");
        if (step->source == NULL) return -1;
    }
    if ((frame->flags & VOIDAGE_MOVES) != 0) {
        step->places = voidage_take(run, &rest, frame->nodes, run->dimension, "places");
        if (step->places == NULL) return -1;
    }
    if ((frame->flags & VOIDAGE_MOVES) != 0) {
        step->motion = voidage_take(run, &rest, frame->nodes, run->dimension, "motion");
        if (step->motion == NULL) return -1;
    }
    step->conditions = frame->text == 0 ? NULL : voidage_text(run);
    return voidage_end(run, &rest);
}

static inline void voidage_put(double **to, const double *from, uint64_t numbers, uint64_t room)
{
    if (numbers > 0) memcpy(*to, from, (size_t)numbers * 8);
    *to += room;
}

/* Copies fields to memory of their own, so that they outlive the request. Before the first time `to` is all zero. */
static inline int voidage_keep(voidage_run *run, voidage_fields *to, const voidage_fields *from)
{
    uint64_t nodes = from->nodes, k;
    size_t count = (size_t)(nodes * (from->dimension + 1 + from->scalars));
    double *at = (double *)realloc(to->memory, (count + 1) * sizeof(double));
    if (at == NULL) return voidage_wrong(run, "there is no memory for fields of %llu nodes", (unsigned long long)nodes);
    to->memory = at;
    to->nodes = nodes;
    to->dimension = from->dimension;
    to->scalars = from->scalars;
    to->velocity = at;
    voidage_put(&at, from->velocity, nodes * from->dimension, nodes * from->dimension);
    to->pressure = at;
    voidage_put(&at, from->pressure, nodes, nodes);
    for (k = 0; k < from->scalars; k++) {
        to->scalar[k] = at;
        voidage_put(&at, from->scalar[k], nodes, nodes);
    }
    return 0;
}

/* Answers a step. */
static inline int voidage_answer(voidage_run *run, const voidage_solution *solution)
{
    const voidage_fields *fields = &solution->fields;
    voidage_header frame = voidage_empty(VOIDAGE_SOLUTION);
    uint64_t over = run->nodes % VOIDAGE_PAD, k;
    uint64_t balances = solution->balances == NULL ? 0 : solution->parts;
    uint64_t bodies = solution->bodies == NULL ? 0 : solution->body_count;
    double *to;
    if (fields->nodes != run->nodes || fields->dimension != run->dimension || fields->scalars != run->scalars) {
        return voidage_wrong(run, "a solution of %llu nodes and %llu scalars, there are %llu and %llu",
                             (unsigned long long)fields->nodes, (unsigned long long)fields->scalars,
                             (unsigned long long)run->nodes, (unsigned long long)run->scalars);
    }
    frame.rows = run->nodes;
    frame.stride = run->nodes + (over == 0 ? 0 : VOIDAGE_PAD - over);
    frame.scalars = (uint32_t)((UINT64_C(1) << run->scalars) - 1);
    frame.parts = balances;
    balances *= VOIDAGE_BALANCE_NUMBERS(run->dimension, run->scalars);
    bodies *= VOIDAGE_BODY_NUMBERS(run->dimension);
    frame.length = frame.stride * (run->dimension + 1 + run->scalars) + balances + bodies + VOIDAGE_REPORT_NUMBERS;
    if (voidage_make_room(run, &run->answer, &run->answer_room, frame.length) < 0) return -1;
    memset(run->answer, 0, (size_t)frame.length * 8);
    to = run->answer;
    if (fields->velocity == NULL) return voidage_wrong(run, "a solution without velocity");
    voidage_put(&to, fields->velocity, run->nodes * run->dimension, frame.stride * run->dimension);
    if (fields->pressure == NULL) return voidage_wrong(run, "a solution without pressure");
    voidage_put(&to, fields->pressure, run->nodes, frame.stride);
    for (k = 0; k < run->scalars; k++) {
        if (fields->scalar[k] == NULL) return voidage_wrong(run, "a solution without a scalar");
        voidage_put(&to, fields->scalar[k], run->nodes, frame.stride);
    }
    voidage_put(&to, solution->balances, balances, balances);
    voidage_put(&to, solution->bodies, bodies, bodies);
    voidage_put(&to, solution->report, VOIDAGE_REPORT_NUMBERS, VOIDAGE_REPORT_NUMBERS);
    return voidage_send_frame(run, frame, run->answer);
}

/* Answers requests by these functions until the run says goodbye. What one of them cannot do, for which it returns
 * -1, the run is told. */
static inline int voidage_serve(voidage_run *run, int (*set_mesh)(voidage_run *), int (*set_state)(voidage_run *),
                                int (*solve)(voidage_run *))
{
    char why[sizeof run->error];
    for (;;) {
        int kind = voidage_receive(run), done = -1;
        if (kind == VOIDAGE_BYE) return 0;
        if (kind == VOIDAGE_MESH) done = set_mesh(run);
        if (kind == VOIDAGE_STATE) done = set_state(run);
        if (kind == VOIDAGE_STEP) done = solve(run);
        if (done < 0) break;
    }
    /* A run that is gone cannot be told: the first error is the cause. */
    memcpy(why, run->error, sizeof why);
    voidage_fail(run, why);
    memcpy(run->error, why, sizeof why);
    return -1;
}

#endif
