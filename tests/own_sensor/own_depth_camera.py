#!/usr/bin/env python3
"""A depth camera that jink does not know, as a process: a row of the process table with
publishes = ["range/cloud/NAME"], and the sensor's name as its argument.

Its images are of a wall 3 m ahead with a post 2 m ahead in front of it, in millimetres, as any camera's SDK hands them out. With
pyrealsense2 `images` would be:

    pipeline = rs.pipeline()
    profile = pipeline.start()
    while True:
        frame = pipeline.wait_for_frames().get_depth_frame()
        yield np.asanyarray(frame.get_data())
"""

import sys
import time

import numpy as np

import jink
from clouds import FRD_OF_OPTICAL, CloudOutput, DepthCamera, Mounting
from foreign import Process

SIZE_PX = (848, 480)
INTRINSICS_PX = (447.0, 447.0, 423.5, 239.5)
RATE_HZ = 15.0
# 4 x 4 would leave 25,440 points; a map cell of 0.2 m is 18 pixels wide at 5 m.
BIN_PX = 4


def images():
    """One image after the other, with the time of its capture (ns)."""
    noise = np.random.default_rng(1)
    scene_mm = np.full((SIZE_PX[1], SIZE_PX[0]), 3_000.0)
    scene_mm[:, 410:440] = 2_000.0
    count = 0
    begin_s = time.monotonic()
    while True:
        count += 1
        time.sleep(max(0.0, begin_s + count / RATE_HZ - time.monotonic()))
        image = (scene_mm + noise.normal(0.0, 5.0, scene_mm.shape)).astype(np.uint16)
        # Holes: a stereo pair finds no match everywhere.
        image[noise.random(image.shape) < 0.05] = 0
        yield image, time.monotonic_ns()


def main():
    process = Process()
    mounting = Mounting(position_m=(0.1, 0.0, 0.0), axes=FRD_OF_OPTICAL)
    camera = DepthCamera(SIZE_PX, INTRINSICS_PX, range_m=(0.3, 5.0), mounting=mounting, bin_px=BIN_PX)
    clouds = CloudOutput(process, sys.argv[-1], camera, RATE_HZ, sigma_m=0.09)
    took_ms = []
    for image, capture_ns in images():
        begin_s = time.monotonic()
        clouds.publish(camera.points(image), capture_ns)
        took_ms.append(1e3 * (time.monotonic() - begin_s))
        process.cycle(begin_s, jink.ServiceState.ACTIVE)
        if len(took_ms) == 150:
            p50, p99 = np.percentile(took_ms, [50, 99])
            print(f"{p50:.1f} / {p99:.1f} ms from image to published cloud (p50 / p99)", flush=True)
            took_ms.clear()
        if process.ends:
            break
    process.stop()


if __name__ == "__main__":
    main()
