/* For user-mode Linux, preloaded: a crystal of its own. The clock that the guest's kernel counts on runs CRYSTAL_PPM
 * millionths faster than that of the machine outside. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <time.h>

static int (*real)(clockid_t clock, struct timespec *now);
static double error;

__attribute__((constructor)) static void find_real(void)
{
    *(void **)&real = dlsym(RTLD_NEXT, "clock_gettime");
    const char *const ppm = getenv("CRYSTAL_PPM");
    error = ppm ? atof(ppm) * 1e-6 : 0.0;
}

int clock_gettime(clockid_t clock, struct timespec *now)
{
    const int result = real(clock, now);
    if (result == 0 && clock == CLOCK_MONOTONIC) {
        const long long outside_ns = now->tv_sec * 1000000000LL + now->tv_nsec;
        const long long ns = outside_ns + (long long)((double)outside_ns * error);
        now->tv_sec = ns / 1000000000LL;
        now->tv_nsec = ns % 1000000000LL;
    }
    return result;
}
