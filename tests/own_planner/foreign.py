"""What a process of jink does besides its own work, for a program in Python: docs/bring_your_own_process.md.

Needs `pip install iceoryx2==0.10.0`, and jink.py, which `jink schema --python` prints, beside it.
"""

import argparse
import ctypes
import os
import signal
import time

import iceoryx2 as iox2
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
        # What comes besides may be ignored: budgets, priority, log level, and with builds to come what is not known yet.
        self.setup, _ = parser.parse_known_args()
        self.ends = False
        signal.signal(signal.SIGTERM, self._end)
        signal.signal(signal.SIGINT, self._end)
        self._node = _node(self.setup.instance)
        self._beat = jink.Heartbeat()
        self._beat.name = _name(self.setup.process)
        self._beat.pid = os.getpid()
        self._beat.generation = self.setup.generation
        self._beat.role = jink.Role.OWNER
        self._beat.state = jink.ServiceState.STARTING
        self._health = Output(self, "health/*", self.setup.process, counts=False)
        self._beat_due = 0.0
        self._send_beat()

    def _end(self, *_):
        self.ends = True

    def service(self, topic, member=""):
        """The service of a topic of the table. The supervisor holds it: it is there."""
        name = iox2.ServiceName.new(topic.replace("*", member))
        builder = self._node.service_builder(name).publish_subscribe(jink.TOPICS[topic].payload)
        return builder.user_header(jink.USER_HEADER).open()

    def notifier(self, topic, member=""):
        """What wakes the readers of a topic; None if nothing does. The supervisor holds it, too."""
        if not jink.TOPICS[topic].wakes:
            return None
        name = iox2.ServiceName.new(topic.replace("*", member))
        return self._node.service_builder(name).event().open().notifier_builder().create()

    def cycle(self, begin_s, state):
        """A cycle that began at `begin_s` (time.monotonic()) has ended: says so when it is due."""
        cycle_us = int((time.monotonic() - begin_s) * 1e6)
        beat = self._beat
        beat.cycles += 1
        beat.cycle_last_us = beat.cycle_p50_us = beat.cycle_p99_us = cycle_us
        beat.cycle_max_us = max(beat.cycle_max_us, cycle_us)
        if state != beat.state or time.monotonic() >= self._beat_due:
            beat.state = state
            self._send_beat()

    def stop(self):
        """The last word: it ends because it was asked to."""
        self._beat.state = jink.ServiceState.STOPPING
        self._send_beat()

    def count_output(self):
        self._beat.outputs += 1

    def _send_beat(self):
        # With it the supervisor distinguishes a process that hangs from one that is given no CPU.
        self._beat.cpu_ms = int(time.process_time() * 1e3)
        self._health.send(self._beat)
        self._beat_due = time.monotonic() + HEARTBEAT_PERIOD_S


class Input:
    """The newest sample of a topic, unless it is stale."""

    def __init__(self, process, topic, member=""):
        self._subscriber = process.service(topic, member).subscriber_builder().create()
        self._deadline_ns = jink.TOPICS[topic].deadline_ms * 1e6
        self._sample = None

    def fresh(self):
        """Payload and header, or None. They stay as they are while they are held: let go of them before the next call."""
        while (sample := self._subscriber.receive()) is not None:
            self._sample = sample
        if self._sample is None:
            return None
        header = self._sample.user_header().contents
        if time.monotonic_ns() - header.publish > self._deadline_ns:
            return None
        return self._sample.payload().contents, header


class Output:
    """A topic to publish. `deadline_us`: the age from its capture at which a sample is stale; 0 = the topic's own."""

    def __init__(self, process, topic, member="", counts=True, deadline_us=0):
        self._process = process if counts else None
        self._generation = process.setup.generation
        self._publisher = process.service(topic, member).publisher_builder().create()
        self._notifier = process.notifier(topic, member)
        self._deadline_us = deadline_us
        self._count = 0

    def send(self, payload, capture_ns=None):
        """Publishes a copy; `capture_ns`: when the newest measurement in it was taken."""
        size = ctypes.sizeof(payload)
        self.write(lambda address: ctypes.memmove(address, ctypes.byref(payload), size), capture_ns)

    def write(self, fill, capture_ns=None, is_measurement=False):
        """Has `fill` write the payload at an address in shared memory, which holds an older one, and publishes it. A measurement
        begins the history of whatever is made of it."""
        loan = self._publisher.loan_uninit()
        fill(loan.payload_ptr)
        sample = loan.assume_init()
        header = sample.user_header().contents
        ctypes.memset(ctypes.byref(header), 0, ctypes.sizeof(header))
        now_ns = time.monotonic_ns()
        self._count += 1
        # It only ever grows, over restarts too.
        header.sequence = self._generation << 32 | self._count
        header.generation = self._generation
        header.capture = now_ns if capture_ns is None else capture_ns
        header.publish = now_ns
        header.deadline_us = self._deadline_us
        if is_measurement:
            # The first stage is the sensor.
            header.stages[0].begin, header.stages[0].end = header.capture, now_ns
        sample.send()
        if self._notifier is not None:
            self._notifier.notify()
        if self._process is not None:
            self._process.count_output()


def _name(text):
    name = jink.Name()
    for index, byte in enumerate(text.encode()[: len(name.bytes)]):
        name.bytes[index] = byte
    return name


def _node(instance):
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
