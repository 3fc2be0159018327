"""Flies a mission as a ground station and listens on the companion link meanwhile, with pymavlink as the decoder.

The autopilot sends to --autopilot-port; every datagram is passed on to the companion at --companion-port and back,
and judged on the way. The mission is flown over --station-port, where the autopilot's ground station link arrives.
Distances to the obstacles come from the world's own description (--world, the JSON of `jink world`), not from jink.

The last line on standard output is one JSON object: outcome, faults (texts; empty = none), and what was counted.
"""

import argparse
import json
import math
import select
import socket
import time
from collections import Counter, deque

from pymavlink.dialects.v20 import common as mavlink

VEHICLE_COMPONENT, AVOIDANCE, COMPUTER = 1, 196, 191
# custom_mode of PX4: main mode 4 (auto) with these sub modes.
HOLD, TAKEOFF, MISSION, LAND = ((sub << 24) | (4 << 16) for sub in (3, 2, 4, 6))
RADIUS_M = 0.3
UNKNOWN = 65535
# PX4 falls to Hold after this long without a trajectory.
STREAM_TIMEOUT_S = 0.5


def finite(*values):
    return all(math.isfinite(value) for value in values)


class Decoder:
    """pymavlink on one direction of a link."""

    def __init__(self, name, faults, relayed=False):
        """A relayed stream holds only some messages of a sender: their numbers have gaps."""
        self.relayed = relayed
        self.mav = mavlink.MAVLink(None)
        self.mav.robust_parsing = True
        self.name = name
        self.faults = faults
        self.sequence = {}

    def messages(self, datagram):
        for message in self.mav.parse_buffer(datagram) or []:
            if message.get_type() == "BAD_DATA":
                self.faults.add(f"{self.name}: bytes that are no message")
                continue
            sender = (message.get_srcSystem(), message.get_srcComponent())
            expected = self.sequence.get(sender)
            if not self.relayed and expected is not None and message.get_seq() != expected:
                self.faults.add(f"{self.name}: {sender} skipped sequence numbers")
            self.sequence[sender] = (message.get_seq() + 1) % 256
            yield message


class Faults:
    """Each kind of fault once, with its first example."""

    def __init__(self):
        self.seen = {}

    def add(self, text):
        self.seen.setdefault(text.split(":", 1)[-1][:60], text)

    def check(self, condition, text):
        if not condition:
            self.add(text)


class CompanionJudge:
    """What comes from the companion."""

    def __init__(self, faults):
        self.faults = faults
        self.count = Counter()
        self.times = {}
        self.max_gap_s = 0.0
        self.requests = {}
        # The autopilot's clock less ours, by its requests of the last second (ns): each is received a little late.
        self.autopilot_clock_ahead = deque(maxlen=10)
        self.answers = 0
        self.states = Counter()
        self.last_curve_s = None
        self.last_setpoint_s = None
        self.points = Counter()

    def note_request(self, message):
        if message.get_type() == "TIMESYNC" and message.tc1 == 0:
            self.requests[message.ts1] = time.monotonic_ns()
            self.autopilot_clock_ahead.append(message.ts1 - time.monotonic_ns())

    def judge(self, message, now):
        kind = message.get_type()
        sender = (message.get_srcSystem(), message.get_srcComponent())
        self.count[kind] += 1
        self.times.setdefault(kind, [now, now])[1] = now
        known = sender[1] == AVOIDANCE or (
            sender[1] == COMPUTER and kind in ("HEARTBEAT", "ONBOARD_COMPUTER_STATUS")
        )
        self.faults.check(known, f"{kind} from component {sender[1]}")
        check = getattr(self, kind.lower(), None)
        if check:
            check(message, now)

    def heartbeat(self, message, _now):
        if message.get_srcComponent() == AVOIDANCE:
            self.faults.check(message.get_srcSystem() == 1, f"heartbeat: system {message.get_srcSystem()}")
            self.states[message.system_status] += 1

    def timesync(self, message, _now):
        if message.tc1 == 0:
            return
        asked = self.requests.pop(message.ts1, None)
        self.faults.check(asked is not None, f"timesync: answer to a request nobody made ({message.ts1})")
        if asked is not None:
            self.answers += 1
            # The companion's clock is the autopilot's own, as it was while the request was under way.
            latest = message.ts1 + time.monotonic_ns() - asked
            between = message.ts1 <= message.tc1 <= latest
            self.faults.check(between, f"timesync: clock {message.tc1} outside {message.ts1}..{latest}")

    def trajectory_representation_bezier(self, m, now):
        self.note_setpoint(now)
        self.last_curve_s = now
        n = m.valid_points
        self.points[n] += 1
        self.faults.check(2 <= n <= 5, f"bezier: {n} points")
        fields = (m.pos_x, m.pos_y, m.pos_z, m.pos_yaw)
        for axis in fields:
            self.faults.check(finite(*axis[:n]), f"bezier: control points {list(axis)}")
            self.faults.check(all(math.isnan(v) for v in axis[n:]), f"bezier: unused points {list(axis)}")
        self.faults.check(all(math.isnan(v) for v in m.delta[n:]), f"bezier: unused delta {list(m.delta)}")
        last = m.delta[n - 1]
        self.faults.check(finite(last) and 0.1 < last < 10.0, f"bezier: duration {last}")
        # The clock that TIMESYNC is answered with.
        self.faults.check(self.autopilot_clock_ahead, "bezier: before any TIMESYNC of the autopilot")
        if not self.autopilot_clock_ahead:
            return
        age_s = (time.monotonic_ns() + max(self.autopilot_clock_ahead)) * 1e-9 - m.time_usec * 1e-6
        self.faults.check(age_s >= 0.0, f"bezier: starts {-age_s:.3f} s in the future")
        self.faults.check(age_s < last, f"bezier: over {age_s - last:.3f} s before it arrived")
        speed = max(
            math.dist((m.pos_x[i], m.pos_y[i], m.pos_z[i]), (m.pos_x[i + 1], m.pos_y[i + 1], m.pos_z[i + 1]))
            for i in range(n - 1)
        ) * (n - 1) / last
        self.faults.check(speed < 8.0, f"bezier: control points ask for {speed:.1f} m/s")

    def trajectory_representation_waypoints(self, m, now):
        if m.valid_points == 0:
            first = self.last_setpoint_s is None
            self.faults.check(first, "waypoints: none valid in the middle of the stream")
            return
        self.note_setpoint(now)
        self.faults.check(self.last_curve_s is None, "waypoints: after curves")
        self.faults.check(m.valid_points == 1, f"waypoints: {m.valid_points} valid points")
        axes = ((m.pos_x, m.vel_x, m.acc_x), (m.pos_y, m.vel_y, m.acc_y), (m.pos_z, m.vel_z, m.acc_z))
        for position, velocity, acceleration in axes:
            given = finite(position[0]) or finite(velocity[0])
            self.faults.check(given, f"waypoints: neither position nor velocity {position[0]} {velocity[0]}")
            unused = position[1:] + velocity[1:] + acceleration
            self.faults.check(all(math.isnan(v) for v in unused), f"waypoints: unused fields {unused}")
        unused = m.pos_yaw[1:] + m.vel_yaw[1:]
        self.faults.check(all(math.isnan(v) for v in unused), f"waypoints: unused headings {unused}")
        self.faults.check(all(c == UNKNOWN for c in m.command), f"waypoints: commands {list(m.command)}")
        speed = math.hypot(*(axis[0] for axis in (m.vel_x, m.vel_y, m.vel_z) if finite(axis[0])))
        self.faults.check(speed < 8.0, f"waypoints: {speed:.1f} m/s")

    def note_setpoint(self, now):
        if self.last_setpoint_s is not None:
            self.max_gap_s = max(self.max_gap_s, now - self.last_setpoint_s)
        self.last_setpoint_s = now

    def obstacle_distance(self, m, _now):
        self.faults.check(m.frame == mavlink.MAV_FRAME_BODY_FRD, f"obstacle_distance: frame {m.frame}")
        self.faults.check(len(m.distances) == 72, f"obstacle_distance: {len(m.distances)} sectors")
        step = m.increment_f or m.increment
        self.faults.check(abs(step - 5.0) < 1e-6, f"obstacle_distance: increment {step}")
        self.faults.check(abs(m.angle_offset) < 1e-6, f"obstacle_distance: offset {m.angle_offset}")
        self.faults.check(0 < m.min_distance < m.max_distance, f"obstacle_distance: range {m.min_distance}")
        good = all(d == UNKNOWN or d <= m.max_distance + 1 for d in m.distances)
        self.faults.check(good, f"obstacle_distance: {list(m.distances)}, maximum {m.max_distance}")

    def rate_hz(self, kind):
        first, last = self.times.get(kind, (0.0, 0.0))
        return (self.count[kind] - 1) / (last - first) if last > first else 0.0


class Clearance:
    """Distance between the vehicle's hull and the obstacles of a world."""

    def __init__(self, world):
        self.cylinders = world["cylinders"]
        self.smallest_m = math.inf

    def see(self, north, east, up):
        for c in self.cylinders:
            if up < c["top_m"]:
                flat = math.hypot(c["north_m"] - north, c["east_m"] - east)
                self.smallest_m = min(self.smallest_m, flat - c["radius_m"] - RADIUS_M)


class Station:
    """Enough of a ground station to fly a mission: it asks again every half second until the vehicle does it."""

    def __init__(self, send, waypoints, height_m):
        self.send = send
        self.waypoints = waypoints
        self.height_m = height_m
        self.phase = "home"
        self.mode = None
        self.armed = False
        self.home = None
        self.up_m = 0.0
        self.reached = -1
        self.asked = 0.0
        self.texts = []
        self.holds = 0

    def take(self, m):
        kind = m.get_type()
        if m.get_srcComponent() != VEHICLE_COMPONENT:
            return
        if kind == "HEARTBEAT":
            if self.phase == "mission" and self.mode == MISSION and m.custom_mode == HOLD:
                self.holds += 1
            self.mode = m.custom_mode
            self.armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        elif kind == "GLOBAL_POSITION_INT":
            if self.home is None and m.lat != 0:
                self.home = (m.lat, m.lon)
            self.up_m = m.relative_alt * 1e-3
        elif kind in ("MISSION_REQUEST_INT", "MISSION_REQUEST"):
            self.send_item(m.seq)
        elif kind == "MISSION_ACK" and self.phase == "upload":
            self.phase = "hold" if m.type == 0 else f"mission refused ({m.type})"
        elif kind == "MISSION_ITEM_REACHED" and self.phase == "mission":
            self.reached = max(self.reached, m.seq)
        elif kind == "STATUSTEXT":
            self.texts.append(m.text)

    def send_item(self, sequence):
        north, east = self.waypoints[sequence]
        lat = self.home[0] + north / 6371000.0 * 180e7 / math.pi
        lon = self.home[1] + east / (6371000.0 * math.cos(math.radians(self.home[0] * 1e-7))) * 180e7 / math.pi
        self.send(
            mavlink.MAVLink_mission_item_int_message(
                1, 1, sequence, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, mavlink.MAV_CMD_NAV_WAYPOINT,
                int(sequence == 0), 1, 0.0, 0.0, 0.0, math.nan, round(lat), round(lon), self.height_m, 0,
            )
        )

    def command(self, command, *params):
        filled = list(params) + [0.0] * (7 - len(params))
        self.send(mavlink.MAVLink_command_long_message(1, 1, command, 0, *filled))

    def set_mode(self, mode):
        # base_mode 1 = custom mode; main and sub mode as PX4 wants them.
        self.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 4.0, float(mode >> 24))

    def step(self, now):
        """Moves on if the vehicle did what was asked, and asks again if not."""
        phase = self.phase
        if phase == "home" and self.home:
            self.phase = "upload"
        elif phase == "hold" and self.mode == HOLD:
            self.phase = "arm"
        elif phase == "arm" and self.armed:
            self.phase = "takeoff"
        elif phase == "takeoff" and self.up_m > 0.8 * self.height_m and self.mode == HOLD:
            self.phase = "mission"
        elif phase == "mission" and self.reached == len(self.waypoints) - 1:
            self.phase = "land"
        elif phase == "land" and not self.armed:
            self.phase = "done"
        if self.phase == phase and now - self.asked < 0.5:
            return
        self.asked = now
        if self.phase == "upload":
            self.send(mavlink.MAVLink_mission_count_message(1, 1, len(self.waypoints), 0))
        elif self.phase == "hold":
            self.set_mode(HOLD)
        elif self.phase == "arm":
            self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        elif self.phase == "takeoff" and self.up_m < 0.5 and self.mode != TAKEOFF:
            self.set_mode(TAKEOFF)
        elif self.phase == "mission" and self.mode != MISSION:
            self.set_mode(MISSION)
        elif self.phase == "land" and self.mode != LAND:
            self.set_mode(LAND)


def bind(port):
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    udp.bind(("127.0.0.1", port))
    udp.setblocking(False)
    return udp


def datagrams(udp):
    while True:
        try:
            yield udp.recvfrom(65536)
        except BlockingIOError:
            return
        except ConnectionRefusedError:
            continue


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("autopilot", "companion", "station"):
        parser.add_argument(f"--{name}-port", type=int, required=True)
    parser.add_argument("--world", required=True, help="JSON of `jink world`")
    parser.add_argument("--waypoint", action="append", required=True, metavar="NORTH,EAST")
    parser.add_argument("--timeout", type=float, default=240.0)
    arguments = parser.parse_args()

    faults = Faults()
    with open(arguments.world, encoding="utf-8") as file:
        clearance = Clearance(json.load(file))
    from_companion, from_autopilot = Decoder("companion", faults), Decoder("autopilot", faults, True)
    judge = CompanionJudge(faults)
    autopilot_side, companion_side, station_side = (
        bind(arguments.autopilot_port), bind(0), bind(arguments.station_port),
    )
    companion = ("127.0.0.1", arguments.companion_port)
    autopilot = station_peer = None
    speaker = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    station_decoder = Decoder("station", faults, True)

    def send(message):
        if station_peer:
            station_side.sendto(message.pack(speaker), station_peer)
            speaker.seq = (speaker.seq + 1) % 256

    waypoints = [tuple(float(part) for part in text.split(",")) for text in arguments.waypoint]
    station = Station(send, waypoints, 2.5)
    begin = time.monotonic()
    beat = 0.0
    phase = None
    while station.phase != "done" and not station.phase.startswith("mission refused"):
        now = time.monotonic()
        if now - begin > arguments.timeout:
            break
        select.select([autopilot_side, companion_side, station_side], [], [], 0.05)
        for data, peer in datagrams(autopilot_side):
            autopilot = peer
            for message in from_autopilot.messages(data):
                judge.note_request(message)
                if message.get_type() == "LOCAL_POSITION_NED":
                    clearance.see(message.x, message.y, -message.z)
            companion_side.sendto(data, companion)
        for data, _ in datagrams(companion_side):
            now = time.monotonic()
            for message in from_companion.messages(data):
                judge.judge(message, now)
            if autopilot:
                autopilot_side.sendto(data, autopilot)
        for data, peer in datagrams(station_side):
            station_peer = peer
            for message in station_decoder.messages(data):
                station.take(message)
        if now - beat > 1.0:
            beat = now
            send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3))
        if station_peer and judge.count["TRAJECTORY_REPRESENTATION_BEZIER"] + judge.count["HEARTBEAT"] > 0:
            station.step(now)
        if station.phase != phase:
            phase = station.phase
            print(f"{now - begin:6.1f} s  {phase}", flush=True)

    faults.check(judge.max_gap_s < STREAM_TIMEOUT_S, f"bezier: a gap of {judge.max_gap_s:.3f} s")
    faults.check(judge.answers > 0, "timesync: no request was answered")
    print(json.dumps({
        "outcome": station.phase,
        "faults": list(faults.seen.values()),
        "reached": station.reached + 1,
        "holds": station.holds,
        "min_clearance_m": clearance.smallest_m,
        "seconds": time.monotonic() - begin,
        "max_gap_ms": judge.max_gap_s * 1e3,
        "timesync_answers": judge.answers,
        "bezier_points": dict(judge.points),
        "avoidance_states": dict(judge.states),
        "counts": dict(judge.count),
        "rates_hz": {kind: round(judge.rate_hz(kind), 2) for kind in judge.count},
        "texts": station.texts[-10:],
    }))


if __name__ == "__main__":
    main()
