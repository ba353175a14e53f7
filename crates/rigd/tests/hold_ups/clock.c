/* Sets the wall clock of the program to and fro: preloaded by hold_ups.rs. At every 300th question the
 * clock jumps by RIGD_CLOCK_JUMP_S seconds, forward and back in turn. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <time.h>

int clock_gettime(clockid_t clock, struct timespec *now) {
    static int questions = 0;
    __typeof__(&clock_gettime) next = (__typeof__(&clock_gettime))dlsym(RTLD_NEXT, "clock_gettime");
    int result = next(clock, now);
    const char *jump = getenv("RIGD_CLOCK_JUMP_S");
    if (clock != CLOCK_REALTIME || result != 0 || !jump) return result;
    int asked = __atomic_add_fetch(&questions, 1, __ATOMIC_SEQ_CST);
    if (asked / 300 % 2 == 1) now->tv_sec += atol(jump);
    return result;
}
