/* Kills the program before one of its calls that change files: preloaded by archive.rs. RIGD_KILL_AT is the
 * number of the call, from 1. The number of calls goes to RIGD_KILL_COUNT. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <unistd.h>

static void count(void) {
    static int calls = 0;
    const char *at = getenv("RIGD_KILL_AT"), *counted = getenv("RIGD_KILL_COUNT");
    int call = __atomic_add_fetch(&calls, 1, __ATOMIC_SEQ_CST);
    if (counted) {
        FILE *file = fopen(counted, "w");
        if (file) { fprintf(file, "%d", call); fclose(file); }
    }
    if (at && call == atoi(at)) kill(getpid(), SIGKILL);
}

#define NEXT(name) count(); __typeof__(&name) next = (__typeof__(&name))dlsym(RTLD_NEXT, #name)

int fsync(int fd) { NEXT(fsync); return next(fd); }
int fdatasync(int fd) { NEXT(fdatasync); return next(fd); }
int rename(const char *from, const char *to) { NEXT(rename); return next(from, to); }
int mkdir(const char *path, mode_t mode) { NEXT(mkdir); return next(path, mode); }
int unlink(const char *path) { NEXT(unlink); return next(path); }
int unlinkat(int at, const char *path, int flags) { NEXT(unlinkat); return next(at, path, flags); }
int rmdir(const char *path) { NEXT(rmdir); return next(path); }
int chmod(const char *path, mode_t mode) { NEXT(chmod); return next(path, mode); }
int ftruncate(int fd, off_t size) { NEXT(ftruncate); return next(fd, size); }
int ftruncate64(int fd, off64_t size) { NEXT(ftruncate64); return next(fd, size); }
