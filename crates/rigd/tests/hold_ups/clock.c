/* Sets the wall clock of the program to and fro: preloaded by hold_ups.rs. At every 300th question the
 * clock jumps by RIGD_CLOCK_JUMP_S seconds, forward and back in turn. If RIGD_CLOCK_BACK is given instead, the clock is an
 * hour back as soon as the file with that name is there. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static int is_back(void) {
    const char *back = getenv("RIGD_CLOCK_BACK");
    return back && access(back, F_OK) == 0;
}

/* SQLite asks for the time by this. */
int gettimeofday(struct timeval *restrict now, void *restrict zone) {
    __typeof__(&gettimeofday) next = (__typeof__(&gettimeofday))dlsym(RTLD_NEXT, "gettimeofday");
    int result = next(now, zone);
    if (result == 0 && is_back()) now->tv_sec -= 3600;
    return result;
}

int clock_gettime(clockid_t clock, struct timespec *now) {
    static int questions = 0;
    __typeof__(&clock_gettime) next = (__typeof__(&clock_gettime))dlsym(RTLD_NEXT, "clock_gettime");
    int result = next(clock, now);
    const char *jump = getenv("RIGD_CLOCK_JUMP_S");
    if (clock != CLOCK_REALTIME || result != 0) return result;
    if (is_back()) now->tv_sec -= 3600;
    if (!jump) return result;
    int asked = __atomic_add_fetch(&questions, 1, __ATOMIC_SEQ_CST);
    if (asked / 300 % 2 == 1) now->tv_sec += atol(jump);
    return result;
}
