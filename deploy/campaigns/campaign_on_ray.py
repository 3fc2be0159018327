#!/usr/bin/env python3
"""Flies a campaign of jink as tasks of Ray, on one machine or on a cluster (pip install ray).

    campaign_on_ray.py --out s3.jsonl --suite S3 --seeds 1..200 --shards 50 --address 192.0.2.7:6379

Takes the options of `jink campaign` (--suite, --cell, --seeds, --density, ...) beside its own. A task is a shard, one call of
jink-campaign; the program is sent to the nodes and flights come back as results, so that nodes need Ray and nothing else. When a node
dies, its shards are flown again on others: the same seed is the same flight. FILE ends up with one line for each flight, sorted by cell
and seed; flights that stand in it already are not flown again. Files that options name have to be on every node, at the same place.

Exit codes: 0 no collision; 1 a collision; 2 wrong arguments; 3 flights are missing.
"""

import argparse
import contextlib
import ctypes
import os
import platform
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import unittest
from collections import Counter
from pathlib import Path

from merge_flights import FLIGHTS_MISSING, Parser, Wrong, flights, merged, missing_lines, read, seeds, self_test
from merge_flights import write

WRONG_ARGUMENTS = 2
PROGRAM = "jink-campaign"
# What this program does itself, or what would stay on a node.
REFUSED = {
    "--json": "flights are written to --out",
    "--resume": "flights that stand in --out are never flown again",
    "--shard": "say with --shards into how many parts the campaign is divided",
    "--svg": "pictures would stay on the nodes; have jink campaign draw single flights",
}
# One call of jink-campaign that flies nothing: no seed of 1..1 is in the first of two shards.
NOTHING = ["--seeds", "1..1", "--shard", "1/2"]


def fly(programs, options, shard, flown):
    """Flies one shard on whichever node this runs.

    `programs`: one reference to the bytes of jink-campaign; `flown`: lines of flights of this shard that have been flown. Uses nothing of
    this file or of others: a node has none of them.
    """
    import ray

    linux_libc, die_with_parent = ctypes.CDLL(None), 1

    def end_with_the_worker():
        linux_libc.prctl(die_with_parent, signal.SIGKILL)

    with tempfile.TemporaryDirectory(prefix="jink_campaign_") as folder:
        program, lines, words = (Path(folder) / name for name in ["jink-campaign", "flights.jsonl", "stderr"])
        program.write_bytes(ray.get(programs[0]))
        program.chmod(0o700)
        lines.write_text(flown)
        command = [str(program), *options, "--shard", shard, "--json", str(lines), "--resume"]
        with words.open("wb") as errors:
            flight = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=errors, preexec_fn=end_with_the_worker
            )
            # It runs without its file. A worker that is killed cleans nothing up, and this is the large one.
            program.unlink()
            code = flight.wait()
        said = words.read_text(errors="replace").replace("\r", "\n").strip().splitlines()
        return {
            "code": code,
            "said": said[-1] if said else "",
            "node": platform.node(),
            "lines": lines.read_text(),
            # What the last bit of sin() depends on. Every ARM processor of 64 bit has FMA and says nothing of it.
            "computes": f"{platform.machine()}, {os.confstr('CS_GNU_LIBC_VERSION')}, "
            + ("FMA" if {"fma", "asimd"} & set(Path("/proc/cpuinfo").read_text().split()) else "no FMA"),
        }


def shards_with_seeds(wanted, shards):
    """Those of `shards` that hold a seed, by jink-campaign's rule: shard I of N flies the seeds that leave I - 1 when divided by N."""
    return sorted({seed % shards + 1 for seed in wanted})


def lines_by_shard(found, wanted, shards):
    """The lines of flights that have been flown, by shard."""
    by_shard = {shard: "" for shard in shards_with_seeds(wanted, shards)}
    for flight in found:
        shard = flight.seed % shards + 1
        if shard in by_shard:
            by_shard[shard] += flight.line + "\n"
    return by_shard


def program_file(given):
    """Where jink-campaign is: as given, beside this program, in the build of this source tree, in PATH."""
    here = Path(__file__).resolve()
    places = [given] if given else [here.with_name(PROGRAM), here.parents[2] / "target/release" / PROGRAM, shutil.which(PROGRAM)]
    for place in places:
        if place and os.access(place, os.X_OK) and Path(place).is_file():
            return str(Path(place).resolve())
    raise Wrong(f"{given}: no program" if given else f"{PROGRAM} is neither beside this program nor in PATH: say --{PROGRAM} PATH")


def arguments_of(words):
    """Own arguments, and those of jink-campaign."""
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="file for one JSON object per flight")
    parser.add_argument("--seeds", default="1..20", metavar="FIRST..LAST", help="seeds, both included (default 1..20)")
    parser.add_argument("--cell", default=[], action="append", metavar="A,B", help="cells of the suite")
    parser.add_argument("--shards", type=int, metavar="N", help="parts of the campaign, each a task (default: a seed each, 100 at most)")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="flights at a time in a task, and CPUs it takes (default 1)")
    parser.add_argument("--jink-campaign", metavar="PATH", help="program to fly with (default: beside this one, or in PATH)")
    parser.add_argument("--address", default="local", metavar="HOST:PORT", help="Ray cluster, or auto (default: this machine alone)")
    parser.add_argument("--retries", type=int, default=3, metavar="N", help="further tries of a shard whose node died (default 3)")
    parser.add_argument("--self-test", action="store_true", help="test this program; needs no Ray")
    own, others = parser.parse_known_args(words)
    for word in others:
        if reason := REFUSED.get(word.partition("=")[0]):
            raise Wrong(f"{word}: {reason}")
    own.wanted = seeds(own.seeds)
    own.shards = min(len(own.wanted), 100) if own.shards is None else own.shards
    for name, least in [("shards", 1), ("jobs", 1), ("retries", 0)]:
        if getattr(own, name) < least:
            raise Wrong(f"--{name}: at least {least}")
    own.cells = [cell for group in own.cell for cell in group.split(",")]
    return own, others + [word for group in own.cell for word in ("--cell", group)]


def check_options(program, options):
    """Has jink-campaign read its arguments; what it finds wrong is said before anything is flown."""
    try:
        asked = subprocess.run([program, *options, *NOTHING], stdin=subprocess.DEVNULL, capture_output=True, text=True)
    except OSError as error:
        raise Wrong(f"{program}: {error.strerror}") from None
    if asked.returncode != 0:
        said = [line for line in asked.stderr.splitlines() if line.strip()]
        raise Wrong(said[0] if said else f"{program} ended with {asked.returncode}")


def first_line(error):
    """An error in one line."""
    return next((line for line in str(error).splitlines() if line.strip()), repr(error))


def say(words):
    """Says something beside the progress."""
    print(f"\r{Path(__file__).stem}: {words}", file=sys.stderr)


def check_address(address):
    """Refuses an address where nobody listens: Ray would try for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host and port.isdecimal():
        try:
            socket.create_connection((host.strip("[]"), int(port)), timeout=10).close()
        except (OSError, OverflowError) as error:
            raise Wrong(f"--address {address}: {getattr(error, 'strerror', None) or error}") from None


def connect(own):
    """Ray, connected to the cluster of --address."""
    # Nobody else has to hear of a campaign.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        import ray
    except ImportError:
        raise Wrong("Ray is missing: pip install ray") from None
    check_address(own.address)
    local = {"include_dashboard": False} if own.address == "local" else {}
    try:
        ray.init(address=own.address, log_to_driver=False, logging_level="error", **local)
    except Exception as error:
        raise Wrong(f"--address {own.address}: {first_line(error)}") from None
    if all(node["Resources"].get("CPU", 0) < own.jobs for node in ray.nodes() if node["Alive"]):
        say(f"no node has {own.jobs} CPUs: waiting for one")
    return ray


def fly_all(own, options, program, ray):
    """Flies what is not in --out yet and writes it there, shard by shard. Returns all flights, and why shards were given up."""
    found = merged(flights(read(own.out), own.out)) if own.out.exists() else []
    write(own.out, found)
    programs = [ray.put(Path(program).read_bytes())]
    task = ray.remote(fly).options(num_cpus=own.jobs, max_retries=own.retries, scheduling_strategy="SPREAD")
    options = [*options, "--seeds", own.seeds, "--jobs", str(own.jobs)]
    flown = lines_by_shard(found, own.wanted, own.shards)

    def start(shard):
        return task.remote(programs, options, f"{shard}/{own.shards}", flown[shard])

    in_work = {start(shard): shard for shard in flown}
    begin, tries, given_up, computes = time.monotonic(), Counter(), [], set()
    with own.out.open("a") as out:
        while in_work:
            (ended,), _ = ray.wait(list(in_work), num_returns=1)
            shard = in_work.pop(ended)
            name = f"shard {shard}/{own.shards}"
            try:
                result = ray.get(ended)
            except ray.exceptions.RayError as error:
                # A node died once too often, or has no room for the program. Ray's advice follows behind the first sentence.
                reason = first_line(getattr(error, "cause", None) or error).partition(". ")[0]
                given_up.append(f"{name}: {reason}")
                continue
            if result["code"] == WRONG_ARGUMENTS:
                raise Wrong(f"{name} on {result['node']}: {result['said']}")
            if result["code"] not in (0, 1):
                # Whatever ended the program, lack of memory for example, may not be so the next time.
                tries[shard] += 1
                words = f"{name} on {result['node']}: {PROGRAM} ended with {result['code']} {result['said']}".rstrip()
                if tries[shard] > own.retries:
                    given_up.append(words)
                else:
                    say(f"{words}; flown again")
                    in_work[start(shard)] = shard
                continue
            if not result["lines"].startswith(flown[shard]):
                raise Wrong(f"{name}: flights that were flown before came back changed")
            new = result["lines"][len(flown[shard]) :]
            found = merged(found + flights(new, name))
            # At once: whoever is killed leaves whole lines.
            out.write(new)
            out.flush()
            if new:
                computes.add(result["computes"])
            done = len(flown) - len(in_work)
            left_s = (time.monotonic() - begin) / done * len(in_work)
            print(f"\r{done} of {len(flown)} shards, {len(found)} flights, {left_s:.0f} s left   ", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    if len(computes) > 1:
        say(f"nodes compute with {' and '.join(sorted(computes))}: a hash may depend on the node")
    write(own.out, found)
    return found, given_up


def report(own, options, program, found, given_up):
    """Names what is missing, has jink-campaign print the table of all flights; the exit code."""
    for line in given_up:
        say(f"given up: {line}")
    absent = missing_lines(found, own.cells, own.wanted)
    for line in absent:
        print(line, file=sys.stderr)
    part = NOTHING if absent or given_up else ["--seeds", own.seeds]
    before = own.out.read_bytes()
    printed = subprocess.run(
        [program, *options, *part, "--json", str(own.out), "--resume"], stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    if printed.returncode not in (0, 1):
        raise Wrong(f"{PROGRAM} does not read {own.out}: {printed.stderr.strip()}")
    if own.out.read_bytes() != before:
        say(f"{PROGRAM} found flights missing in {own.out} that no shard had missed")
        return FLIGHTS_MISSING
    return FLIGHTS_MISSING if absent or given_up else printed.returncode


def campaign(words):
    """Does what the arguments say; the exit code."""
    own, options = arguments_of(words)
    program = program_file(own.jink_campaign)
    check_options(program, options)
    if not own.out.absolute().parent.is_dir():
        raise Wrong(f"--out {own.out}: there is no such folder")
    # Ray says on standard output that nodes died; that is for the table.
    with contextlib.redirect_stdout(sys.stderr):
        ray = connect(own)
        try:
            found, given_up = fly_all(own, options, program, ray)
        except OSError as error:
            raise Wrong(f"{own.out}: {error.strerror}") from None
        finally:
            ray.shutdown()
    return report(own, options, program, found, given_up)


class CampaignTest(unittest.TestCase):
    """What can be checked without Ray."""

    def test_options_of_jink_campaign_are_passed_through(self):
        own, options = arguments_of("--suite S3 --out a --cell slot,corner --density 0.04 --seeds 3..7 --address x:1 -v".split())
        self.assertEqual(options, ["--suite", "S3", "--density", "0.04", "-v", "--cell", "slot,corner"])
        self.assertEqual((own.cells, list(own.wanted), own.shards), (["slot", "corner"], [3, 4, 5, 6, 7], 5))

    def test_options_that_this_program_sees_to_are_refused(self):
        for option in ["--shard 1/2", "--shard=1/2", "--json a", "--resume", "--svg a", "--seeds 5..1", "--shards 0", "--jobs x"]:
            with self.assertRaises(Wrong, msg=option):
                arguments_of(["--out", "a", *option.split()])

    def test_every_seed_is_in_one_shard_and_shards_without_a_seed_are_left_out(self):
        self.assertEqual(shards_with_seeds(range(1, 13), 6), [1, 2, 3, 4, 5, 6])
        self.assertEqual(shards_with_seeds(range(4, 6), 6), [5, 6])

    def test_flown_lines_go_to_the_shard_of_their_seed(self):
        line = '{"suite": "", "profile": "", "sensor": "", "speed_mps": 3.0, "density_per_m2": null, "cell": "gap", "hash": "", "seed": %d}\n'
        found = flights("".join(line % seed for seed in [4, 5, 6, 99]), "a")
        self.assertEqual(lines_by_shard(found, range(4, 7), 2), {1: line % 4 + line % 6, 2: line % 5 + line % 99})


def main():
    """Runs the program."""
    if sys.argv[1:] == ["--self-test"]:
        sys.exit(self_test())
    try:
        sys.exit(campaign(sys.argv[1:]))
    except Wrong as error:
        print(f"campaign_on_ray: {error}", file=sys.stderr)
        sys.exit(WRONG_ARGUMENTS)
    except KeyboardInterrupt:
        print("\ncampaign_on_ray: interrupted; the same command goes on", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
