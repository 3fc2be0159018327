"""A ground station that says what it is asked to send, with pymavlink as its encoder and decoder.

Reads one JSON object a line from standard input and answers each with one line:

| order | answer |
|---|---|
| {"do": "open", "line", "port", "system", "component", "passphrase", "link_id"} | {} |
| {"do": "send", "line", "kind", "fields", "signed", "until", "from"} | {"received": messages} |
| {"do": "set", "line", "name", "value", "type"}, a PARAM_SET to 196 | {"received": messages} |
| {"do": "wait", "line", "kind", "count"} | {"received": messages} |
| {"do": "tally", "line"} | {"bad", "kinds", component: count, gaps, stamps that did not grow, first and last stamp} |
| {"do": "verify", "line", "passphrase"} | {"taken", "taken_again", "of"}: frames that the key fits, and when played back |

`send` returns everything received until as many messages of each kind in `until` have come and a question asked afterwards was
answered: what was to be said before has been said by then. A kind may name its component ("HEARTBEAT 196"). `signed` is no, right, wrong (another key), old (a stamp
of two hours ago) or again (the last one that was right, byte for byte); `from` is another sender's [system, component]. A failure is answered with {"error": text}.
"""

import hashlib
import json
import math
import socket
import struct
import sys
import threading
import time
import traceback
from collections import Counter, deque

from pymavlink.dialects.v20 import common as mavlink

PATIENCE_S = 60.0
VEHICLE, AVOIDANCE = 1, 196
# The component that asks whether everything before has been answered.
LAST_WORD = 77
# It asks about messages with numbers from here on, which nobody has.
QUESTIONS_FROM = 20_000
ASK_AGAIN_S = 2.0
FORMATS = {1: "B", 2: "b", 3: "H", 4: "h", 5: "I", 6: "i", 9: "f"}
EPOCH_S = 1420070400


def teach(number, name, crc_extra, form, **fields):
    """Adds a message to pymavlink that its own definitions lack, in the shape that its decoder wants: with the lengths of
    its fields, 0 for what is no array."""

    def __init__(self, *values):
        mavlink.MAVLink_message.__init__(self, number, name)
        self._fieldnames = self.fieldnames
        for field, value in zip(fields, values):
            setattr(self, field, plain(value))

    lengths = list(fields.values())
    kind = {
        "__init__": __init__,
        "id": number,
        "msgname": name,
        "fieldnames": list(fields),
        "ordered_fieldnames": list(fields),
        "orders": list(range(len(fields))),
        "lengths": [1 if "s" in form else max(length, 1) for length in lengths],
        "array_lengths": lengths,
        "crc_extra": crc_extra,
        "unpacker": struct.Struct(form),
    }
    mavlink.mavlink_map[number] = type(name, (mavlink.MAVLink_message,), kind)


teach(397, "COMPONENT_METADATA", 182, "<II100s", time_boot_ms=0, file_crc=0, uri=100)
teach(300, "PROTOCOL_VERSION", 217, "<HHH8B8B", version=0, min_version=0, max_version=0, spec=8, library=8)


def key_of(passphrase):
    return hashlib.sha256(passphrase.encode()).digest()


def plain(value):
    """As JSON has it: no bytes, and numbers that are none as text."""
    if isinstance(value, (bytes, bytearray)):
        return value.rstrip(b"\0").decode("ascii", "replace")
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def names(messages):
    """Each message's kind, alone and with the component that said it."""
    for message in messages:
        yield message.get_type()
        yield f"{message.get_type()} {message.get_srcComponent()}"


def facts(message):
    found = {name: plain(getattr(message, name)) for name in message.fieldnames}
    found["kind"] = message.get_type()
    found["component"] = message.get_srcComponent()
    found["system"] = message.get_srcSystem()
    if found["kind"] == "PARAM_VALUE":
        # Beside a PX4 integers travel byte-wise.
        bits = struct.pack("<f", message.param_value)
        form = FORMATS[message.param_type]
        found["value"] = struct.unpack_from("<" + form, bits)[0]
    return found


class Tally:
    """What one component of ours has said on one line."""

    def __init__(self):
        self.count = 0
        self.gaps = []
        self.next = None
        self.not_later = 0
        self.unsigned = 0
        self.first_stamp = self.last_stamp = None

    def take(self, message):
        frame = message.get_msgbuf()
        self.count += 1
        if self.next is not None and message.get_seq() != self.next:
            self.gaps.append([self.next, message.get_seq()])
        self.next = (message.get_seq() + 1) % 256
        if not frame[2] & 1:
            self.unsigned += 1
            return
        stamp = int.from_bytes(frame[-12:-6], "little")
        if self.last_stamp is not None and stamp <= self.last_stamp:
            self.not_later += 1
        self.first_stamp = self.first_stamp or stamp
        self.last_stamp = stamp


class Line:
    """One UDP link of the gateway, this side of it."""

    def __init__(self, order):
        self.peer = ("127.0.0.1", order["port"])
        self.sender = (order.get("system", 255), order.get("component", 190))
        self.link_id = order.get("link_id", 0)
        self.passphrase = order.get("passphrase")
        self.sequence = Counter()
        self.stamp = 0
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.udp.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        self.udp.bind(("127.0.0.1", 0))
        self.decoder = mavlink.MAVLink(None)
        self.decoder.robust_parsing = True
        self.received = deque()
        self.frames = deque(maxlen=300)
        self.tallies = {}
        self.bad = 0
        self.kinds = Counter()
        self.last_right = None
        self.questions = 0
        self.arrived = threading.Condition()
        threading.Thread(target=self.listen, daemon=True).start()

    def listen(self):
        while True:
            data = self.udp.recv(65536)
            with self.arrived:
                for message in self.decoder.parse_buffer(data) or []:
                    if message.get_type() == "BAD_DATA":
                        self.bad += 1
                        continue
                    self.received.append(message)
                    self.kinds[message.get_type()] += 1
                    if message.get_srcComponent() in (191, 196):
                        self.frames.append(bytes(message.get_msgbuf()))
                        self.tallies.setdefault(message.get_srcComponent(), Tally()).take(message)
                self.arrived.notify_all()

    def send(self, message, signed="no", sender=None):
        if signed == "again":
            self.udp.sendto(self.last_right, self.peer)
            return
        sender = tuple(sender or self.sender)
        mav = mavlink.MAVLink(None, srcSystem=sender[0], srcComponent=sender[1])
        mav.seq = self.sequence[sender]
        self.sequence[sender] = (mav.seq + 1) % 256
        if signed != "no":
            now = int((time.time() - EPOCH_S) * 1e5)
            self.stamp = max(self.stamp + 1, now)
            mav.signing.secret_key = key_of("another" if signed == "wrong" else self.passphrase)
            mav.signing.link_id = self.link_id
            mav.signing.timestamp = now - 7200 * 100_000 if signed == "old" else self.stamp
            mav.signing.sign_outgoing = True
        frame = message.pack(mav)
        if signed == "right" and sender == self.sender:
            self.last_right = frame
        self.udp.sendto(frame, self.peer)

    def forget(self):
        with self.arrived:
            self.received.clear()

    def until(self, is_enough, what, patience_s=PATIENCE_S):
        """Everything received since `forget`, once that is enough."""
        end = time.monotonic() + patience_s
        with self.arrived:
            while not is_enough(self.received):
                left = end - time.monotonic()
                if left <= 0 or not self.arrived.wait(left):
                    kinds = Counter(f"{m.get_type()} of {m.get_srcComponent()}" for m in self.received)
                    raise TimeoutError(f"{what} never came; received {dict(kinds)}")
            return list(self.received)

    def settle(self, signed):
        """Asks something that was never asked before, again and again, and returns everything received until the answer."""
        sender = (self.sender[0], LAST_WORD)
        self.questions += 1
        about = QUESTIONS_FROM + self.questions
        question = mavlink.MAVLink_command_long_message(
            VEHICLE, AVOIDANCE, mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 0, about, 0, 0, 0, 0, 0, 0
        )
        is_it = lambda m: m.get_type() == "MESSAGE_INTERVAL" and m.message_id == about
        end = time.monotonic() + PATIENCE_S
        while True:
            self.send(question, signed, sender)
            try:
                patience_s = min(ASK_AGAIN_S, end - time.monotonic())
                everything = self.until(lambda received: any(map(is_it, received)), "the last answer", patience_s)
                break
            except TimeoutError:
                if time.monotonic() > end:
                    raise
        is_last_word = lambda m: (
            m.get_type() == "COMMAND_ACK" and m.target_component == LAST_WORD
            or m.get_type() == "MESSAGE_INTERVAL" and m.message_id > QUESTIONS_FROM
        )
        return [m for m in everything if not is_last_word(m)]


def message_of(kind, fields):
    build = getattr(mavlink, f"MAVLink_{kind.lower()}_message")
    filled = {}
    for name, form in zip(build.fieldnames, build.fieldtypes):
        value = fields.get(name, 0)
        if form == "char":
            value = (value or "").encode()
        filled[name] = value
    return build(**filled)


class Station:
    def __init__(self):
        self.lines = {}

    def open(self, order):
        self.lines[order["line"]] = Line(order)
        return {}

    def send(self, order):
        line = self.lines[order["line"]]
        signed = order.get("signed", "no")
        wanted = order.get("until", {})
        line.forget()
        line.send(message_of(order["kind"], order["fields"]), signed, order.get("from"))
        if wanted:
            line.until(lambda received: not Counter(wanted) - Counter(names(received)), f"{wanted}")
        received = line.settle(order.get("settle", "right" if line.passphrase else "no"))
        return {"received": [facts(message) for message in received]}

    def set(self, order):
        bits = struct.pack("<" + FORMATS[order["type"]], order["value"]).ljust(4, b"\0")
        fields = {
            "target_system": VEHICLE,
            "target_component": AVOIDANCE,
            "param_id": order["name"],
            "param_type": order["type"],
            "param_value": struct.unpack("<f", bits)[0],
        }
        line = self.lines[order["line"]]
        line.forget()
        line.send(message_of("PARAM_SET", fields))
        # The owner of the parameters is another process: what is asked behind it may be answered before it.
        is_answer = lambda m: m.get_type() in ("PARAM_VALUE", "PARAM_ERROR") and m.get_srcComponent() == AVOIDANCE
        line.until(lambda received: any(map(is_answer, received)), "an answer to PARAM_SET")
        return {"received": [facts(message) for message in line.settle("no")]}

    def wait(self, order):
        line = self.lines[order["line"]]
        kind, count = order["kind"], order.get("count", 1)
        line.forget()
        received = line.until(lambda received: sum(m.get_type() == kind for m in received) >= count, f"{count} {kind}")
        return {"received": [facts(message) for message in received]}

    def tally(self, order):
        line = self.lines[order["line"]]
        with line.arrived:
            tallies = {component: vars(tally) for component, tally in line.tallies.items()}
            return {"bad": line.bad, "kinds": line.kinds, **tallies}

    def verify(self, order):
        line = self.lines[order["line"]]
        with line.arrived:
            frames = list(line.frames)
        receiver = mavlink.MAVLink(None)
        receiver.robust_parsing = True
        receiver.signing.secret_key = key_of(order["passphrase"])

        def takes(frame):
            messages = receiver.parse_buffer(bytearray(frame)) or []
            return [m.get_type() for m in messages] not in ([], ["BAD_DATA"])

        return {
            "of": len(frames),
            "taken": sum(takes(frame) for frame in frames),
            "taken_again": sum(takes(frame) for frame in frames),
        }


def main():
    station = Station()
    for text in sys.stdin:
        order = json.loads(text)
        try:
            answer = getattr(station, order["do"])(order)
        except Exception:  # Whatever it is, the test has to read it.
            answer = {"error": traceback.format_exc()}
        print(json.dumps(answer), flush=True)


main()
