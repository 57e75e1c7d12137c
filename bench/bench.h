/* bench.h: what elf-bench measures: tables of cases, each one piece of work timed against the
 * machine's own multiply-add limit in the same run.
 *
 * To add cases, write a table in a file of its own and name it in main.c's list of tables.
 */
#ifndef LF_BENCH_BENCH_H
#define LF_BENCH_BENCH_H

/* A piece of work with its data. */
typedef struct lf_bench_work lf_bench_work;
struct lf_bench_work {
    double flop;                          /* of one run; 0: only the time is reported */
    double bytes;                         /* moved by one run, for cases bound by memory; else 0 */
    double memory;                        /* bytes held, if known after a run; else 0 */
    void (*run)(lf_bench_work *work);     /* with all threads */
    double (*error)(lf_bench_work *work); /* largest difference to the double reference over the
                                           * largest value; NULL: not checked */
    void (*close)(lf_bench_work *work);   /* free the data and the work itself */
};

typedef struct lf_bench_case lf_bench_case;
struct lf_bench_case {
    const char *name;
    const char *what; /* one line for --list */
    lf_bench_work *(*open)(const lf_bench_case *c);
    long size[8]; /* open's own parameters */
    int variant;
};

typedef struct lf_bench_table {
    const lf_bench_case *cases;
    int count;
} lf_bench_table;

extern const lf_bench_table lf_bench_limits;          /* limit.c */
extern const lf_bench_table lf_bench_kernels;         /* kernels.c */
extern const lf_bench_table lf_bench_steps;           /* steps.c */
extern const lf_bench_table lf_bench_ray_equivariant; /* ray_equivariant.c */
extern const lf_bench_table lf_bench_ibrnet;          /* ibrnet.c */
extern const lf_bench_table lf_bench_onednn;          /* peer_onednn.c, if it was found */

/* Seconds of a steady clock. */
double lf_bench_now(void);

#endif
