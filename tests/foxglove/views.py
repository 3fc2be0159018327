"""What `jink-foxglove convert` writes, as readers that others wrote decode it.

    python3 tests/foxglove/views.py VIEWS.mcap

Needs the packages mcap and mcap-protobuf-support; says NOT TESTED without them. Exit code 1: a promise is broken.
"""

import json
import math
import struct
import sys

try:
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory
except ImportError as error:
    print(f"NOT TESTED: the views of a recording with readers of others ({error})")
    sys.exit(0)

failures = 0


def check(promise, holds, details=""):
    global failures
    print(f"{'ok' if holds else 'FAILED'}: {promise}{'' if holds or not details else f' ({details})'}")
    failures += not holds


counts, last, times, first, points, numbers = {}, {}, {}, None, {}, {}
protobuf = DecoderFactory()
decoders = {}
with open(sys.argv[1], "rb") as file:
    reader = make_reader(file)
    for schema, channel, message in reader.iter_messages():
        if channel.message_encoding == "json":
            sample = json.loads(message.data)
            properties = json.loads(schema.data)["properties"]
            numbers[channel.topic] = numbers.get(channel.topic, True) and all(
                name in properties and math.isfinite(value) for name, value in sample.items()
            )
        else:
            decoder = decoders.setdefault(schema.id, protobuf.decoder_for(channel.message_encoding, schema))
            sample = decoder(message.data)
        topic = (channel.topic, schema.name)
        counts[topic] = counts.get(topic, 0) + 1
        last[channel.topic] = sample
        first = min(first or message.log_time, message.log_time)
        times[channel.topic] = max(times.get(channel.topic, 0), message.log_time)
        if schema.name == "foxglove.PointCloud":
            points[channel.topic] = points.get(channel.topic, 0) + len(sample.data) // sample.point_stride

for (topic, name), count in sorted(counts.items()):
    extra = f", {points[topic] / count:.0f} points each" if topic in points else ""
    print(f"  {topic:28} {name:28} {count:6}{extra}")
span_s = (max(times.values()) - first) * 1e-9
print(f"  {span_s:.1f} s")

check("JSON is numbers of its schema", len(numbers) == 4 and all(numbers.values()), str(numbers))
pose, transform = last["/vehicle/state"].pose, last["/tf"].transforms[0]
check("the vehicle is where its frame is", pose.position.x == transform.translation.x and pose.orientation.w == transform.rotation.w)
check("frames are map and base_link", (transform.parent_frame_id, transform.child_frame_id) == ("map", "base_link"))
ring = last["/guard/ring"]
check("the ring has 72 sectors around the vehicle", len(ring.ranges) == 72 and abs(ring.end_angle - math.radians(355)) < 1e-9)
cloud = last["/map/local"]
x, y, z = struct.unpack_from("<3f", cloud.data) if cloud.data else (0.0, 0.0, 0.0)
here = pose.position
check("the map is around the vehicle", bool(cloud.data) and max(abs(x - here.x), abs(y - here.y), abs(z - here.z)) < 60.0)
print(f"{failures} promises are broken" if failures else "all promises are kept")
sys.exit(1 if failures else 0)
