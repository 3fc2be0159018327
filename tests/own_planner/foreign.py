"""What a process of jink does besides its own work, for a program in Python: docs/bring_your_own_process.md.

Needs jink.py, which `jink schema --python` prints, beside it, and `pip install iceoryx2==0.10.0` unless it only ever runs in campaigns.
"""

import argparse
import ctypes
import os
import signal
import socket
import struct
import time

import jink

# Heartbeats per second: two missed ones are a hang unless the row says otherwise.
HEARTBEAT_PERIOD_S = 0.05


class Process:
    """One start of a process: its topics, its heartbeat, and whether it is to end."""

    def __init__(self):
        parser = argparse.ArgumentParser(allow_abbrev=False)
        parser.add_argument("--process", required=True)
        parser.add_argument("--instance", default="default")
        parser.add_argument("--config", default="config")
        parser.add_argument("--generation", type=int, default=1)
        parser.add_argument("--lockstep")
        # What comes besides may be ignored: budgets, priority, log level, and with builds to come what is not known yet.
        self.setup, _ = parser.parse_known_args()
        self.ends = False
        signal.signal(signal.SIGTERM, self._end)
        signal.signal(signal.SIGINT, self._end)
        self.link = _LockStep(self.setup.lockstep) if self.setup.lockstep else _SharedMemory(self.setup.instance)
        self._beat = jink.Heartbeat()
        self._beat.name = _name(self.setup.process)
        self._beat.pid = os.getpid()
        self._beat.generation = self.setup.generation
        self._beat.role = jink.Role.OWNER
        self._beat.state = jink.ServiceState.STARTING
        self._health = Output(self, "health/*", self.setup.process, counts=False)
        self._beat_due_ns = 0
        self._send_beat()

    def _end(self, *_):
        self.ends = True

    def now_ns(self):
        """The board's time, that of all samples."""
        return self.link.now_ns()

    def wait(self, period_s):
        """Sleeps. In lock-step that time passes at once."""
        self.ends |= not self.link.wait(period_s)

    def cycle(self, begin_s, state):
        """A cycle that began at `begin_s` (time.monotonic()) has ended: says so when it is due."""
        cycle_us = self.link.cycle_us(begin_s)
        beat = self._beat
        beat.cycles += 1
        beat.cycle_last_us = beat.cycle_p50_us = beat.cycle_p99_us = cycle_us
        beat.cycle_max_us = max(beat.cycle_max_us, cycle_us)
        if state != beat.state or self.now_ns() >= self._beat_due_ns:
            beat.state = state
            self._send_beat()

    def stop(self):
        """The last word: it ends because it was asked to."""
        self._beat.state = jink.ServiceState.STOPPING
        self._send_beat()
        self.link.close()

    def count_output(self):
        self._beat.outputs += 1

    def _send_beat(self):
        # With it the supervisor distinguishes a process that hangs from one that is given no CPU.
        self._beat.cpu_ms = int(time.process_time() * 1e3)
        self._health.send(self._beat)
        self._beat_due_ns = self.now_ns() + int(HEARTBEAT_PERIOD_S * 1e9)


class Input:
    """The newest sample of a topic, unless it is stale."""

    def __init__(self, process, topic, member=""):
        self._process = process
        self._newest = process.link.reader(topic, topic.replace("*", member))
        self._deadline_ns = jink.TOPICS[topic].deadline_ms * 1e6

    def fresh(self, view=False):
        """Copies of payload and header, or None. `view=True`: the sample itself, which no one copies, for maps and clouds: let go of
        it, and of everything taken out of it, before the next call."""
        newest = self._newest()
        if newest is None or self._process.now_ns() - newest[1].publish > self._deadline_ns:
            return None
        return newest if view else tuple(type(part).from_buffer_copy(part) for part in newest)


class Output:
    """A topic to publish. `deadline_us`: the age from its capture at which a sample is stale; 0 = the topic's own."""

    def __init__(self, process, topic, member="", counts=True, deadline_us=0):
        self._process = process
        self._counts = counts
        self._publish = process.link.writer(topic, topic.replace("*", member))
        self._deadline_us = deadline_us
        self._count = 0

    def send(self, payload, capture_ns=None):
        """Publishes a copy; `capture_ns`: when the newest measurement in it was taken."""
        size = ctypes.sizeof(payload)
        self.write(lambda address: ctypes.memmove(address, ctypes.byref(payload), size), capture_ns)

    def write(self, fill, capture_ns=None, is_measurement=False):
        """Has `fill` write the payload at an address in memory, which holds an older one, and publishes it. A measurement begins the
        history of whatever is made of it."""
        now_ns = self._process.now_ns()
        self._count += 1
        generation = self._process.setup.generation
        header = jink.SampleHeader()
        # It only ever grows, over restarts too.
        header.sequence = generation << 32 | self._count
        header.generation = generation
        header.capture = now_ns if capture_ns is None else capture_ns
        header.publish = now_ns
        header.deadline_us = self._deadline_us
        if is_measurement:
            # The first stage is the sensor.
            header.stages[0].begin, header.stages[0].end = header.capture, now_ns
        self._publish(fill, header)
        if self._counts:
            self._process.count_output()


class _SharedMemory:
    """The topics of a running instance. The supervisor holds them: they are there."""

    def __init__(self, instance):
        import iceoryx2

        self._iox2 = iceoryx2
        self._node = _node(iceoryx2, instance)

    @staticmethod
    def now_ns():
        return time.monotonic_ns()

    @staticmethod
    def wait(period_s):
        time.sleep(period_s)
        return True

    @staticmethod
    def cycle_us(begin_s):
        return int((time.monotonic() - begin_s) * 1e6)

    def _service(self, topic, name):
        builder = self._node.service_builder(self._iox2.ServiceName.new(name))
        return builder.publish_subscribe(jink.TOPICS[topic].payload).user_header(jink.USER_HEADER).open()

    def reader(self, topic, name):
        subscriber, held = self._service(topic, name).subscriber_builder().create(), None

        def newest():
            nonlocal held
            while (sample := subscriber.receive()) is not None:
                held = sample
            return held and (held.payload().contents, held.user_header().contents)

        return newest

    def writer(self, topic, name):
        publisher, notifier = self._service(topic, name).publisher_builder().create(), None
        if jink.TOPICS[topic].wakes:
            builder = self._node.service_builder(self._iox2.ServiceName.new(name))
            notifier = builder.event().open().notifier_builder().create()

        def publish(fill, header):
            loan = publisher.loan_uninit()
            fill(loan.payload_ptr)
            sample = loan.assume_init()
            ctypes.memmove(sample.user_header(), ctypes.byref(header), ctypes.sizeof(header))
            sample.send()
            if notifier is not None:
                notifier.notify()

        return publish

    def close(self):
        pass


class _LockStep:
    """The topics of a campaign, whose time stands still until this process has answered (services/runtime/src/lockstep/relay.rs)."""

    _HEAD = struct.Struct("<cBI")

    def __init__(self, path):
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.connect(path)
        self._file = self._socket.makefile("rb")
        self._message, self._newest, self._now_ns = bytearray(), {}, 0
        self._receive()

    def now_ns(self):
        return self._now_ns

    @staticmethod
    def cycle_us(_begin_s):
        return 0

    def wait(self, period_s):
        self._send(self._now_ns + int(period_s * 1e9))
        return self._receive()

    def reader(self, topic, name):
        self._announce(b"R", topic, name)
        self._newest[name] = None, jink.TOPICS[topic].payload
        return lambda: self._newest[name][0]

    def writer(self, topic, name):
        self._announce(b"W", topic, name)
        payload = jink.TOPICS[topic].payload()

        def publish(fill, header):
            fill(ctypes.addressof(payload))
            self._record(b"S", name, bytes(header) + bytes(payload))

        return publish

    def close(self):
        self._send(0)
        self._socket.close()

    def _announce(self, kind, topic, name):
        payload = jink.TOPICS[topic].payload
        self._record(kind, name, struct.pack("<I", ctypes.sizeof(payload)) + payload.type_name().encode())

    def _record(self, kind, name, rest):
        self._message += self._HEAD.pack(kind, len(name), len(rest)) + name.encode() + rest

    def _send(self, wake_ns):
        self._record(b"E", "", struct.pack("<Q", wake_ns))
        self._socket.sendall(self._message)
        self._message.clear()

    def _receive(self):
        """What is new; whether the process is to go on."""
        while True:
            head = self._file.read(self._HEAD.size)
            if len(head) < self._HEAD.size:
                return False
            kind, name_len, rest_len = self._HEAD.unpack(head)
            name, rest = self._file.read(name_len).decode(), self._file.read(rest_len)
            if kind == b"E":
                (time_ns,) = struct.unpack("<Q", rest)
                self._now_ns = time_ns or self._now_ns
                return time_ns != 0
            payload = self._newest[name][1]
            header_size = ctypes.sizeof(jink.SampleHeader)
            sample = payload.from_buffer_copy(rest, header_size), jink.SampleHeader.from_buffer_copy(rest)
            self._newest[name] = sample, payload


def _name(text):
    name = jink.Name()
    for index, byte in enumerate(text.encode()[: len(name.bytes)]):
        name.bytes[index] = byte
    return name


def _node(iox2, instance):
    config = iox2.config.default()
    config.global_cfg.root_path = iox2.Path.new(f"/dev/shm/jink_{instance}/iox")
    config.global_cfg.prefix = iox2.FileName.new(f"jink_{instance}-")
    # That is the supervisor's work.
    config.global_cfg.node.cleanup_dead_nodes_on_creation = False
    config.global_cfg.node.cleanup_dead_nodes_on_destruction = False
    config.global_cfg.service.cleanup_dead_nodes_on_open = False
    return (
        iox2.NodeBuilder.new()
        .config(config)
        .signal_handling_mode(iox2.SignalHandlingMode.Disabled)
        .create(iox2.ServiceType.Ipc)
    )
