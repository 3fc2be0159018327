"""Every return of a VLP-16 recording as velodyne-decoder decodes it: scan,ring,column,range_m,x_m,y_m,z_m on standard output.

Usage: with_velodyne_decoder.py RECORDING MODEL. The frame is x forward, y left, z up; vertical corrections of the lasers are not applied.
"""

import math
import sys

import velodyne_decoder as vd

recording, model = sys.argv[1:3]
config = vd.Config(model=getattr(vd.Model, model))
number = 0
for _, points in vd.read_pcap(recording, config):
    for point in points:
        x, y, z = (float(value) for value in point[:3])
        column, ring = int(point[5]), int(point[6])
        print(f"{number},{ring},{column},{math.sqrt(x * x + y * y + z * z):.4f},{x:.7f},{y:.7f},{z:.7f}")
    number += 1
