"""Reads a telemetry log with pymavlink, as mavlogdump.py does.

The last line on standard output is one JSON object: `messages` = how many of each kind and sending component
("HEARTBEAT 196"), `bad` = what was no message, `span_s` = time between the first and the last, `backwards` = steps back in time.
"""

import json
import sys
from collections import Counter

from pymavlink import mavutil


def main():
    log = mavutil.mavlink_connection(sys.argv[1], dialect="common", robust_parsing=True)
    messages, bad, times = Counter(), 0, []
    while (message := log.recv_msg()) is not None:
        kind = message.get_type()
        if kind == "BAD_DATA":
            bad += 1
            continue
        messages[f"{kind} {message.get_srcComponent()}"] += 1
        times.append(message._timestamp)
    span_s = times[-1] - times[0] if times else 0.0
    backwards = sum(b < a for a, b in zip(times, times[1:]))
    print(json.dumps({"messages": messages, "bad": bad, "span_s": span_s, "backwards": backwards}))


main()
