/* A sensor of somebody else's as a process of jink, for C and C++: link libjink_own_sensor.a.
 *
 * The library does what every process of jink does: the command line, topics, heartbeat, the end on SIGTERM. The row of the process
 * table says which topic it may publish and, as its argument, the sensor's name (docs/bring_your_own_process.md). jink.h is what
 * `jink schema --c` prints. */
#ifndef JINK_SENSOR_H
#define JINK_SENSOR_H

#include "jink.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    /* Clouds per second (Hz): a cloud is stale two and a half periods of it and the table's delay_ms after its capture. */
    double rate_hz;
    /* How often `next` is called (Hz), 1 to 1000. */
    uint32_t poll_hz;
    /* Handed to both functions; used by no other thread while jink_cloud_run runs. */
    void *context;
    /* Whether there is a new cloud (1) or not (0). `capture_ns`: when the newest measurement in it was taken (CLOCK_MONOTONIC; now_ns
     * is the present). It must not wait: the heartbeat goes out between its calls. */
    int (*next)(void *context, uint64_t now_ns, uint64_t *capture_ns);
    /* Writes that cloud where its readers will find it. It holds an older one: every field that counts is to be written, all but
     * first_point, which holds capture_ns: of an image all points were measured at once. */
    void (*fill)(void *context, jink_point_cloud_t *cloud);
} jink_cloud_sensor_t;

/* Runs until SIGTERM. Returns the exit code of the process. */
int jink_cloud_run(const jink_cloud_sensor_t *sensor);

#ifdef __cplusplus
}
#endif

#endif
