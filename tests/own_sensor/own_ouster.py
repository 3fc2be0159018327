#!/usr/bin/env python3
"""An Ouster lidar through ouster-sdk as a process: a row of the process table with publishes = ["range/cloud/NAME"] and two arguments,
a recording (or the host name of a sensor: ouster.sdk.open_source takes both) and the sensor's name.

A recording is repeated at the pace at which it was made, until the process is asked to end.
"""

import sys
import time

import numpy as np
from ouster.sdk import core, open_source

import jink
from clouds import FRD_OF_FLU, CloudOutput, Mounting, Points
from foreign import Process

# What every OS sensor sees of a target of 10 % within OA_CARVE_RNG; farther returns clear the way up to here.
RANGE_M = (0.5, 40.0)
# 128 x 1024 returns become 64 x 512 points, the nearest of each 2 x 2.
REDUCE = 2


class Reducer:
    """Keeps the nearest return of each few beams and columns."""

    def __init__(self, shape):
        self._rows, self._columns = shape[0] // REDUCE, shape[1] // REDUCE
        self._all = np.arange(self._rows * self._columns)

    def _blocks(self, image):
        b, rows, columns = REDUCE, self._rows, self._columns
        more = image.shape[2:]
        image = image[: rows * b, : columns * b].reshape(rows, b, columns, b, *more)
        return image.swapaxes(1, 2).reshape(rows * columns, b * b, *more)

    def nearest(self, range_mm, *others):
        """`others`, images of the same size, where the nearest return is. No return counts as infinitely far."""
        blocks = self._blocks(np.where(range_mm > 0, range_mm, np.iinfo(range_mm.dtype).max))
        place = blocks.argmin(axis=1)
        return [self._blocks(other)[self._all, place] for other in others]


def scans(source):
    """One scan after the other, at the pace at which they were made."""
    begin_s, first_ns = time.monotonic(), None
    for frames in source:
        frame = frames[0]
        last_ns = int(frame.timestamp.max())
        first_ns = last_ns if first_ns is None else first_ns
        time.sleep(max(0.0, begin_s + (last_ns - first_ns) * 1e-9 - time.monotonic()))
        yield frame


def main():
    process = Process()
    path, name = sys.argv[-2:]
    source = open_source(path)
    info = source.sensor_info[0]
    # The sensor's own axes: forward, left, up.
    lut = core.XYZLut(info, use_extrinsics=False)
    points = Points(RANGE_M, Mounting(axes=FRD_OF_FLU))
    clouds = CloudOutput(process, name, points, rate_hz=10.0, sigma_m=0.03)
    reducer = None
    while not process.ends:
        for frame in scans(source):
            begin_s, now_ns = time.monotonic(), time.monotonic_ns()
            range_mm = frame.field(core.ChanField.RANGE)
            reducer = reducer or Reducer(range_mm.shape)
            # Columns whose packets were lost have no time and no returns.
            stamps_ns = np.where(frame.status & 1, frame.timestamp, frame.timestamp.max()).astype(np.int64)
            offsets_s = np.broadcast_to((stamps_ns - stamps_ns.min()) * 1e-9, range_mm.shape)
            xyz_m, offsets_s = reducer.nearest(range_mm, lut(frame), offsets_s)
            cloud = points.points(xyz_m, offsets_s)
            # The sensor counts its own time: its last column has just arrived.
            clouds.publish(cloud, now_ns, first_ns=now_ns - int(stamps_ns.max() - stamps_ns.min()))
            process.cycle(begin_s, jink.ServiceState.ACTIVE)
            print(f"{len(cloud)} points, {np.count_nonzero(cloud['kind'])} known, {1e3 * (time.monotonic() - begin_s):.1f} ms", flush=True)
            if process.ends:
                break
        # The end of a recording: from its beginning again.
        source = open_source(path)
    process.stop()


if __name__ == "__main__":
    main()
