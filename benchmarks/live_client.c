/* Sends frames to a stream and times its answers, so that no interpreter is late; `load.py` runs it.

       live_client SOURCE_PORT SINK_PORT FRAMES RATE COUNT

   A line of the file FRAMES is a frame without `{"t":…,` and `}`. They are sent over and over, with a time and
   a number as `id`, at RATE [Hz], or where it is 0 as soon as the one before is answered. For each of COUNT
   frames, standard output gets three doubles [µs]: when it was sent, how long after that its answer began to
   arrive, and the latency in the answer; NaN where none came. */
#define _POSIX_C_SOURCE 200809L
#include <arpa/inet.h>
#include <errno.h>
#include <math.h>
#include <netinet/tcp.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <time.h>

enum { LONGEST = 1 << 18, MOST = 1 << 26, FIRST = -2 }; /* bytes of an answer, frames, `id` before all others */
static const double PATIENCE = 120e6, AFTER = 1e6, AGAIN = 5e5, SOON = 2e5; /* µs */

typedef struct { double sent, latency, told; } Times;

static int source, sink;
static bool known; /* whether both connections are */
static long count;
static Times *times;
static double begun; /* when the answer in `data` began to arrive */
static char *frames, *next_frame, *frames_end;
static char data[LONGEST];
static size_t rest;

static void fail(const char *what) {
    fprintf(stderr, "live_client: %s%s%s\n", what, errno ? ": " : "", errno ? strerror(errno) : "");
    exit(1);
}

static double now(void) {
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return 1e6 * (double)time.tv_sec + 1e-3 * (double)time.tv_nsec;
}

static double number(const char *text, double least, double most) {
    char *end;
    const double value = strtod(text, &end);
    if (end == text || *end || !(value >= least && value <= most)) fail("an argument is no number in its bounds");
    return value;
}

static int connected(const char *port) {
    struct sockaddr_in peer = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    peer.sin_port = htons((unsigned short)number(port, 1, 65535));
    const struct timeval patience = {.tv_sec = (time_t)(1e-6 * PATIENCE)};
    const int on = 1, made = socket(AF_INET, SOCK_STREAM, 0);
    const bool usable = made >= 0 && made < FD_SETSIZE;
    if (!usable || connect(made, (struct sockaddr *)&peer, sizeof peer)) fail("no connection");
    setsockopt(made, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    setsockopt(made, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
    return made;
}

/* Sends the next frame and returns when. */
static double send_frame(double time, long id) {
    char before[64], after[64], *const stop = memchr(next_frame, '\n', (size_t)(frames_end - next_frame));
    struct iovec part[] = {{before, 0}, {next_frame, (size_t)(stop - next_frame)}, {after, 0}};
    next_frame = stop + 1 < frames_end ? stop + 1 : frames;
    part[0].iov_len = (size_t)snprintf(before, sizeof before, "{\"t\":%.6f,", time);
    part[2].iov_len = (size_t)snprintf(after, sizeof after, ",\"id\":%ld}\n", id);
    const size_t all = part[0].iov_len + part[1].iov_len + part[2].iov_len;
    const double sent = now();
    if (writev(source, part, 3) != (ssize_t)all) fail("the stream took no frame");
    return sent;
}

static void take(const char *answer) {
    const char *told = strstr(answer, "\"latency_us\":"), *id = strstr(answer, "\"id\":");
    if (!told || !id) return; /* it is stale or a refusal */
    const long which = strtol(id + 5, NULL, 10);
    known |= which == FIRST;
    if (which < 0 || which >= count || !isnan(times[which].latency)) return;
    times[which].latency = begun - times[which].sent;
    times[which].told = strtod(told + 13, NULL);
}

/* Waits for answers, so long at most [µs], and takes those that are there. */
static void receive(double wait) {
    fd_set ready;
    FD_ZERO(&ready);
    FD_SET(sink, &ready);
    const long long whole = wait > 0.0 ? (long long)(1e3 * wait) : 0; /* ns */
    const struct timespec most = {.tv_sec = whole / 1000000000, .tv_nsec = (long)(whole % 1000000000)};
    if (!pselect(sink + 1, &ready, NULL, NULL, &most, NULL)) return;
    const double arrived = now();
    errno = 0;
    const ssize_t taken = recv(sink, data + rest, LONGEST - rest, 0);
    if (taken <= 0) fail("the stream has hung up");
    if (!rest) begun = arrived;
    char *line = data, *const end = data + rest + taken;
    for (char *stop; (stop = memchr(line, '\n', (size_t)(end - line))); line = stop + 1) {
        *stop = '\0';
        take(line);
        begun = arrived;
    }
    rest = (size_t)(end - line);
    if (rest == LONGEST) fail("an answer is too long");
    memmove(data, line, rest);
}

static void read_frames(const char *path) {
    FILE *file = fopen(path, "rb");
    const long size = file && !fseek(file, 0, SEEK_END) ? ftell(file) : 0;
    if (size < 1 || !(frames = malloc((size_t)size))) fail(path);
    rewind(file);
    if (fread(frames, 1, (size_t)size, file) != (size_t)size || frames[size - 1] != '\n') fail(path);
    fclose(file);
    next_frame = frames, frames_end = frames + size;
}

int main(int argc, char **argv) {
    if (argc != 6) fail("usage: live_client SOURCE_PORT SINK_PORT FRAMES RATE COUNT");
    signal(SIGPIPE, SIG_IGN);
    read_frames(argv[3]);
    const double rate = number(argv[4], 0.0, 1e6), interval = rate > 0.0 ? 1e6 / rate : 0.0;
    count = (long)number(argv[5], 1, MOST);
    if (!(times = malloc((size_t)count * sizeof *times))) fail("no memory");
    for (long i = 0; i < count; i++) times[i] = (Times){NAN, NAN, NAN};
    source = connected(argv[1]), sink = connected(argv[2]);
    const double start = now();
    for (double time = -1e6; !known; receive(AGAIN)) { /* until both connections are known */
        if (now() > start + PATIENCE) fail("no answer");
        send_frame(time += 1.0, FIRST);
    }
    const double begin = now() + SOON;
    for (long i = 0; i < count; i++) {
        const double due = begin + (double)i * interval, most = now() + PATIENCE;
        for (double left; (left = due - now()) > 0.0;) receive(left);
        times[i].sent = send_frame((interval > 0.0 ? 1e-6 * interval : 1e-3) * (double)i, i);
        while (interval == 0.0 && isnan(times[i].latency) && now() < most) receive(most - now());
    }
    for (const double end = now() + AFTER; isnan(times[count - 1].latency) && now() < end;) receive(end - now());
    for (long i = 0; i < count; i++) times[i].sent -= begin;
    if (fwrite(times, sizeof *times, (size_t)count, stdout) != (size_t)count || fflush(stdout)) fail("no output");
    return 0;
}
