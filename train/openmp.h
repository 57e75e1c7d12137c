/* openmp.h: how long OpenMP's threads spin before they sleep.
 *
 * libgomp lets waiting threads spin for long, which is right for a program that has the machine to
 * itself and ruinous for one that does not: with another process on the cores a training was seen
 * to fall from 21 to 2 steps a second. 10000 turns cost nothing measurable on an idle machine (10.8
 * ms a step against 11.1) and leave the cores to others. libgomp reads the setting when it is
 * loaded, so the program starts itself again; what the user has set is respected.
 */
#ifndef LF_TRAIN_OPENMP_H
#define LF_TRAIN_OPENMP_H

#include <stdlib.h>
#include <unistd.h>

/* First thing in main; returns if nothing is to be done or the program cannot be started again. */
static inline void lf_openmp_wait_briefly(char **argv)
{
    if (getenv("OMP_WAIT_POLICY") || getenv("GOMP_SPINCOUNT"))
        return;
    if (setenv("GOMP_SPINCOUNT", "10000", 1) == 0)
        execv("/proc/self/exe", argv);
}

#endif
