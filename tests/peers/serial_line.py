"""A serial line between a pseudo-terminal and a UDP port, as slow as a real one.

The first line on standard output is the terminal's path. Each direction carries --bytes-per-s and no more. Towards the
terminal, streams that come while the line is still busy are left out, as an autopilot thins them out on a slow port;
everything else waits its turn. It ends with standard input; the last line is one JSON object: bytes and seconds per
direction, the busiest second, streams left out, and the most bytes that ever waited.
"""

import argparse
import json
import os
import select
import socket
import sys
import termios
import time
import tty
from collections import deque

# ATTITUDE, ATTITUDE_QUATERNION, LOCAL_POSITION_NED, GLOBAL_POSITION_INT, ALTITUDE and the other streams of an autopilot;
# HEARTBEAT, TIMESYNC, the desired path, answers and texts are none.
KEPT = {0, 21, 22, 42, 77, 111, 148, 242, 244, 245, 253, 332, 345}
# A stream waits for so long at most (s).
PATIENCE_S = 0.05
TICK_S = 0.005


class Direction:
    """What one way of the line has carried."""

    def __init__(self, bytes_per_s):
        self.bytes_per_s = bytes_per_s
        self.due = time.monotonic()
        self.begin = None
        self.bytes = self.left_out = self.most_waiting = 0
        self.seconds = {}

    def may(self):
        """Bytes that may pass now: what the time since the last call allows, of at most a few ticks."""
        now = time.monotonic()
        self.due = max(self.due, now - 10 * TICK_S)
        return int((now - self.due) * self.bytes_per_s)

    def pass_on(self, count):
        now = time.monotonic()
        self.begin = self.begin or now
        self.due += count / self.bytes_per_s
        self.bytes += count
        second = int(now - self.begin)
        self.seconds[second] = self.seconds.get(second, 0) + count

    def figures(self):
        span_s = time.monotonic() - self.begin if self.begin else 0.0
        return {
            "bytes": self.bytes,
            "span_s": round(span_s, 2),
            "busiest_second": max(self.seconds.values(), default=0),
            "left_out": self.left_out,
            "most_waiting": self.most_waiting,
        }


def frames(data):
    """Takes all whole frames from the front of a bytearray; bytes that begin none are passed over."""
    while len(data) >= 3:
        if data[0] not in (0xFD, 0xFE):
            del data[0]
            continue
        length = data[1] + 8 if data[0] == 0xFE else data[1] + 12 + (13 if data[2] & 1 else 0)
        if len(data) < length:
            return
        yield bytes(data[:length])
        del data[:length]


def message_id(frame):
    return int.from_bytes(frame[7:10], "little") if frame[0] == 0xFD else frame[5]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--bytes-per-s", type=float, required=True)
    arguments = parser.parse_args()
    ours, theirs = os.openpty()
    tty.setraw(ours)
    tty.setraw(theirs, termios.TCSANOW)
    os.set_blocking(ours, False)
    print(os.ttyname(theirs), flush=True)
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    udp.bind(("127.0.0.1", arguments.port))
    udp.setblocking(False)
    peer = None
    up, down = Direction(arguments.bytes_per_s), Direction(arguments.bytes_per_s)
    waiting, waits = deque(), 0
    arriving = bytearray()
    while True:
        readable, _, _ = select.select([udp, sys.stdin], [], [], TICK_S)
        if sys.stdin in readable and not sys.stdin.readline():
            break
        if udp in readable:
            try:
                while True:
                    frame, peer = udp.recvfrom(65536)
                    is_stream = message_id(frame) not in KEPT
                    if is_stream and waits > PATIENCE_S * arguments.bytes_per_s:
                        down.left_out += 1
                        continue
                    waiting.append(frame)
                    waits += len(frame)
            except BlockingIOError:
                pass
        down.most_waiting = max(down.most_waiting, waits)
        room = down.may()
        while waiting and room > 0:
            piece, rest = waiting[0][:room], waiting[0][room:]
            try:
                count = os.write(ours, piece)
            except BlockingIOError:
                break
            rest = waiting[0][count:]
            waiting.popleft()
            if rest:
                waiting.appendleft(rest)
            down.pass_on(count)
            waits -= count
            room -= count
        room = up.may()
        if room > 0:
            try:
                data = os.read(ours, room)
                up.pass_on(len(data))
                arriving.extend(data)
                for frame in frames(arriving):
                    if peer:
                        udp.sendto(frame, peer)
            except (BlockingIOError, OSError):
                pass
    print(json.dumps({"up": up.figures(), "down": down.figures()}), flush=True)


main()
