"""Every return of an Ouster recording as the maker's SDK decodes it: scan,row,column,range_m,x_m,y_m,z_m on standard output.

Usage: with_ouster_sdk.py RECORDING METADATA. Ranges of one pixel stand on lines of their own.
"""

import sys

import numpy
from ouster.sdk import core, pcap

recording, metadata = sys.argv[1:3]
info = core.SensorInfo(open(metadata).read())
to_points = core.XYZLut(info, use_extrinsics=False)
batch = core.FrameBatcher(info)
new_frame = core.LidarFrame


def write(number, frame):
    valid = (frame.status & 1) == 1
    for name in ("RANGE", "RANGE2"):
        if not frame.has_field(name):
            continue
        ranges = frame.field(name)
        points = to_points(ranges)
        rows, columns = numpy.nonzero((ranges > 0) & valid[None, :])
        for row, column in zip(rows, columns):
            x, y, z = points[row, column]
            print(f"{number},{row},{column},{ranges[row, column] / 1000:.4f},{x:.7f},{y:.7f},{z:.7f}")


frame, number, open_frame = new_frame(info), 0, False
for item in pcap.PcapPacketSource(recording, sensor_info=[info]):
    packet = item[1] if isinstance(item, tuple) else item
    if not isinstance(packet, core.LidarPacket):
        continue
    open_frame = True
    if batch.batch(packet, frame):
        write(number, frame)
        number, open_frame, frame = number + 1, False, new_frame(info)
if open_frame:
    write(number, frame)
