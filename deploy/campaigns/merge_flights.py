#!/usr/bin/env python3
"""Merges the parts of a campaign that was flown on several machines into one JSON Lines file.

    merge_flights.py --out all.jsonl --seeds 1..200 part-*.jsonl
    jink campaign ... --seeds 1..200 --json all.jsonl --resume     # flies nothing, prints the table

The file is sorted by cell and seed and holds exactly one line for every flight, as jink-campaign wrote it. A flight that is there
twice is refused, and so are flights of different campaigns; flights that are missing are named by cell and seed.

Exit codes: 0 every flight is there; 2 wrong arguments or files; 3 flights are missing.
"""

import argparse
import json
import os
import sys
import unittest
from pathlib import Path
from typing import NamedTuple

FLIGHTS_MISSING = 3


class Wrong(Exception):
    """What was asked for cannot be done; the text is the one line that says why."""


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the usage."""

    def error(self, message):
        raise Wrong(f"{message}; see --help")


class Flight(NamedTuple):
    """The report of one flight."""

    cell: str
    seed: int
    campaign: tuple
    """Suite and profile: the same in all flights of a campaign."""
    settings: tuple
    """Sensor, speed and density: the same in all flights of a cell."""
    hash: str
    line: str
    """As jink-campaign wrote it."""
    place: str
    """File and line."""


def seeds(text):
    """The seeds of FIRST..LAST, both included."""
    first, _, last = text.partition("..")
    if not (first.isdecimal() and last.isdecimal() and int(first) <= int(last)):
        raise Wrong(f"--seeds {text}: expected FIRST..LAST, the first not above the last")
    return range(int(first), int(last) + 1)


def whole_lines(text):
    """`text` without a last line that was not written to its end."""
    return text[: text.rfind("\n") + 1]


def flights(text, name):
    """The flights in the JSON Lines `text` of the file `name`."""
    found = []
    for number, line in enumerate(whole_lines(text).splitlines(), 1):
        place = f"{name}:{number}"
        try:
            report = json.loads(line)
            campaign = (report["suite"], report["profile"])
            settings = (report["sensor"], report["speed_mps"], report["density_per_m2"])
            found.append(Flight(report["cell"], report["seed"], campaign, settings, report["hash"], line, place))
        except (ValueError, TypeError, KeyError) as error:
            raise Wrong(f"{place}: not the report of a flight: {error!r}") from None
    return found


def merged(found):
    """All flights, sorted by cell and seed; refuses one that is there twice and flights of different campaigns."""
    settings, by_name = {}, {}
    for flight in found:
        first = found[0]
        if flight.campaign != first.campaign:
            raise Wrong(f"{flight.place}: a flight of {flight.campaign}, that of {first.place} is of {first.campaign}")
        of_cell = settings.setdefault(flight.cell, flight)
        if flight.settings != of_cell.settings:
            raise Wrong(
                f"{flight.place}: {flight.cell} with sensor, speed, density {flight.settings}, "
                f"with {of_cell.settings} in {of_cell.place}"
            )
        other = by_name.setdefault((flight.cell, flight.seed), flight)
        if other is not flight:
            hashes = "with the same hash" if other.hash == flight.hash else "WITH ANOTHER HASH"
            raise Wrong(f"{flight.place}: {flight.cell} seed {flight.seed} is in {other.place} already, {hashes}")
    return [by_name[name] for name in sorted(by_name)]


def missing(found, cells, wanted):
    """Seeds that are missing, by cell. Cells: those of `cells`, and those of which there is any flight."""
    there = {(flight.cell, flight.seed) for flight in found}
    cells = sorted({*cells, *(flight.cell for flight in found)})
    lacks = {cell: [seed for seed in wanted if (cell, seed) not in there] for cell in cells}
    return {cell: absent for cell, absent in lacks.items() if absent}


def spans(numbers):
    """Ascending numbers as text: [1, 2, 3, 7] is "1..3, 7"."""
    runs = []
    for number in numbers:
        if runs and runs[-1][1] == number - 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return ", ".join(str(first) if first == last else f"{first}..{last}" for first, last in runs)


def missing_lines(found, cells, wanted):
    """What is missing, a line for each cell; empty if nothing is."""
    if not found and not cells:
        return [f"missing: all cells, seeds {spans(wanted)}"]
    return [f"missing: {cell}, seeds {spans(absent)}" for cell, absent in missing(found, cells, wanted).items()]


def write(path, found):
    """Writes the lines of `found` in place of what is in `path`: whoever is killed leaves the file before or the one after."""
    beside = path.with_name(path.name + ".new")
    beside.write_text("".join(flight.line + "\n" for flight in found))
    os.replace(beside, path)


def read(path):
    """The text of a file."""
    try:
        return Path(path).read_text()
    except (OSError, ValueError) as error:
        raise Wrong(f"{path}: {getattr(error, 'strerror', None) or error}") from None


class MergeTest(unittest.TestCase):
    """What can be checked without a flight."""

    @staticmethod
    def text(*names, speed=4.0, suite="S3", hash="aa"):
        report = {"suite": suite, "profile": "px4_offboard", "sensor": "lidar8", "speed_mps": speed, "density_per_m2": None}
        return "".join(json.dumps({**report, "cell": cell, "seed": seed, "hash": hash}) + "\n" for cell, seed in names)

    def test_flights_are_sorted_by_cell_and_by_seed_as_a_number(self):
        found = flights(self.text(("slot", 2), ("corner", 10)), "a") + flights(self.text(("corner", 9)), "b")
        self.assertEqual([(f.cell, f.seed) for f in merged(found)], [("corner", 9), ("corner", 10), ("slot", 2)])

    def test_lines_stay_as_they_were_written(self):
        text = self.text(("slot", 2)).replace(", ", ",  ")
        self.assertEqual(flights(text, "a")[0].line + "\n", text)

    def test_a_flight_that_is_there_twice_is_refused_and_the_hashes_are_compared(self):
        once = flights(self.text(("slot", 2)), "a")
        with self.assertRaisesRegex(Wrong, "b:1: slot seed 2 is in a:1 already, with the same hash"):
            merged(once + flights(self.text(("slot", 2)), "b"))
        with self.assertRaisesRegex(Wrong, "WITH ANOTHER HASH"):
            merged(once + flights(self.text(("slot", 2), hash="bb"), "b"))

    def test_flights_of_different_campaigns_are_refused(self):
        found = flights(self.text(("slot", 2)), "a")
        with self.assertRaisesRegex(Wrong, "b:1: slot with sensor, speed, density"):
            merged(found + flights(self.text(("slot", 3), speed=5.0), "b"))
        with self.assertRaisesRegex(Wrong, "b:1: a flight of"):
            merged(found + flights(self.text(("forest", 3), suite="S1"), "b"))

    def test_missing_flights_are_named_by_cell_and_seed(self):
        found = flights(self.text(("corner", 1), ("corner", 4), ("slot", 2)), "a")
        self.assertEqual(
            missing_lines(found, ["gap_1.5"], range(1, 5)),
            ["missing: corner, seeds 2..3", "missing: gap_1.5, seeds 1..4", "missing: slot, seeds 1, 3..4"],
        )
        self.assertEqual(missing_lines(found, [], range(1, 1)), [])
        self.assertEqual(missing_lines([], [], range(1, 4)), ["missing: all cells, seeds 1..3"])

    def test_a_last_line_that_was_cut_off_is_no_flight_and_any_other_is_an_error(self):
        text = self.text(("slot", 2), ("slot", 3))
        self.assertEqual(len(flights(text[:-5], "a")), 1)
        with self.assertRaisesRegex(Wrong, "a:2: not the report of a flight"):
            flights(text[:-5] + "\n", "a")
        with self.assertRaisesRegex(Wrong, "a:1: not the report of a flight"):
            flights("[]\n", "a")

    def test_seeds_are_read_as_jink_campaign_reads_them(self):
        self.assertEqual(list(seeds("3..5")), [3, 4, 5])
        for wrong in ["3", "5..3", "a..b", "-1..3", ".."]:
            with self.assertRaises(Wrong):
                seeds(wrong)


def self_test():
    """Runs the tests of the program that was started; its exit code."""
    result = unittest.main(argv=[sys.argv[0]], exit=False).result
    return 0 if result.wasSuccessful() and result.testsRun else 1


def merge(words):
    """Does what the arguments say; the exit code."""
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False)
    parser.add_argument("parts", nargs="+", metavar="PART", help="file that jink-campaign --json wrote")
    parser.add_argument("--out", required=True, type=Path, metavar="FILE", help="file of all flights; may be one of the parts")
    parser.add_argument("--seeds", required=True, metavar="FIRST..LAST", help="seeds of the campaign, both included")
    parser.add_argument("--cell", default=[], action="append", metavar="A,B", help="cells of the campaign; without it those of which there is a flight")
    parser.add_argument("--self-test", action="store_true", help="test this program")
    arguments = parser.parse_args(words)
    wanted = seeds(arguments.seeds)
    cells = [cell for group in arguments.cell for cell in group.split(",")]
    found = merged([flight for part in arguments.parts for flight in flights(read(part), part)])
    try:
        write(arguments.out, found)
    except OSError as error:
        raise Wrong(f"{arguments.out}: {error.strerror}") from None
    print(f"{len(found)} flights in {arguments.out}")
    absent = missing_lines(found, cells, wanted)
    for line in absent:
        print(line, file=sys.stderr)
    return FLIGHTS_MISSING if absent else 0


def main():
    """Runs the program."""
    if sys.argv[1:] == ["--self-test"]:
        sys.exit(self_test())
    try:
        sys.exit(merge(sys.argv[1:]))
    except Wrong as error:
        print(f"merge_flights: {error}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
