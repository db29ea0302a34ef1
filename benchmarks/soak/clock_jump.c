/* Loaded before libc: adds an offset, read from the file named in CLOCK_JUMP_FILE, to the system clock of one process.
   The monotonic clock stays what it is, as it does when a system clock is set. A wait until a time of the system clock
   lasts until that clock shows it, also when the clock is set in the middle of the wait, as it does in the kernel. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define SLICE 10000000L /* the offset is looked at this often during a wait [ns] */

static long long ahead(void)
{
    static const volatile long long *offset;
    if (!offset) {
        const char *path = getenv("CLOCK_JUMP_FILE");
        int file = path ? open(path, O_RDONLY) : -1;
        void *page = file >= 0 ? mmap(0, sizeof *offset, PROT_READ, MAP_SHARED, file, 0) : MAP_FAILED;
        if (file >= 0)
            close(file);
        if (page == MAP_FAILED)
            return 0;
        offset = page;
    }
    return *offset;
}

static int kernel_clock(clockid_t which, struct timespec *now)
{
    static int (*real)(clockid_t, struct timespec *);
    if (!real)
        real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    return real(which, now);
}

int clock_gettime(clockid_t which, struct timespec *now)
{
    int failed = kernel_clock(which, now);
    if (!failed && which == CLOCK_REALTIME)
        now->tv_sec += ahead();
    return failed;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone)
{
    struct timespec exact;
    (void)zone;
    if (clock_gettime(CLOCK_REALTIME, &exact))
        return -1;
    now->tv_sec = exact.tv_sec;
    now->tv_usec = exact.tv_nsec / 1000;
    return 0;
}

int pthread_cond_timedwait(pthread_cond_t *restrict condition, pthread_mutex_t *restrict mutex,
                           const struct timespec *restrict until)
{
    typedef int wait_t(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);
    static wait_t *real;
    if (!real) /* there is an older one of that name, for another kind of condition */
        real = (wait_t *)dlvsym(RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2");
    for (;;) {
        struct timespec end = *until, slice;
        end.tv_sec -= ahead();
        kernel_clock(CLOCK_REALTIME, &slice);
        slice.tv_nsec += SLICE;
        slice.tv_sec += slice.tv_nsec / 1000000000L;
        slice.tv_nsec %= 1000000000L;
        int last = end.tv_sec < slice.tv_sec || (end.tv_sec == slice.tv_sec && end.tv_nsec <= slice.tv_nsec);
        int result = real(condition, mutex, last ? &end : &slice);
        if (result != ETIMEDOUT || last)
            return result;
    }
}
