"""Three nodes of Ray on this machine fly a small campaign, one of them is killed half-way: nothing is lost, nothing counted twice.

    python3 tests/peers/ray_loses_a_node.py --jink-campaign target/release/jink-campaign      (pip install ray)

The first node has the driver and flies nothing, the others fly a flight at a time each. One of these is killed with SIGKILL, with
all its processes, while it flies, after a third of the flights. In the end every flight must have the hash that jink-campaign alone gives it.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from ray.cluster_utils import Cluster

CAMPAIGN_ON_RAY = Path(__file__).resolve().parents[2] / "deploy/campaigns/campaign_on_ray.py"
PATIENCE_S = 1200


def parents():
    """The parent of every process of this machine, and its name."""
    found = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            number, _, rest = stat.read_text().partition(" (")
        except OSError:
            continue  # It has just ended.
        name, _, rest = rest.rpartition(") ")
        found[int(number)] = (int(rest.split()[1]), name)
    return found


def family(pid):
    """A process and all below it, with their names."""
    found, known = parents(), {pid}
    while more := {child for child, (parent, _) in found.items() if parent in known} - known:
        known |= more
    return {member: found[member][1] for member in known if member in found}


def hashes(path):
    """The hash of every flight in a file, by cell and seed."""
    reports = [json.loads(line) for line in path.read_text().splitlines()]
    by_flight = {(report["cell"], report["seed"]): report["hash"] for report in reports}
    assert len(by_flight) == len(reports), f"{path}: a flight is there twice"
    return by_flight


def until(what, is_so):
    """Waits for a condition."""
    begin = time.monotonic()
    while not is_so():
        assert time.monotonic() - begin < PATIENCE_S, f"waited for {what} in vain"
        time.sleep(0.05)


def main():
    """Runs the drill."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--jink-campaign", required=True, metavar="PATH")
    parser.add_argument("--seeds", default="1..12", metavar="FIRST..LAST")
    parser.add_argument("--shards", default="6", metavar="N")
    arguments = parser.parse_args()
    program = str(Path(arguments.jink_campaign).resolve())
    what = ["--suite", "S3", "--cell", "corner", "--seeds", arguments.seeds]
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        # Also for Ray, of which a node that is killed cleans nothing up.
        os.environ["TMPDIR"] = folder
        plain, out = Path(folder) / "plain.jsonl", Path(folder) / "ray.jsonl"
        alone = subprocess.run([program, *what, "--jobs", "2", "--json", str(plain)], stdout=subprocess.PIPE, text=True)
        assert alone.returncode in (0, 1), alone
        expected = hashes(plain)

        cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0})
        victim, survivor = cluster.add_node(num_cpus=1), cluster.add_node(num_cpus=1)
        cluster.wait_for_nodes()
        ours = [CAMPAIGN_ON_RAY, *what, "--shards", arguments.shards, "--jink-campaign", program]
        ours = [sys.executable, *map(str, ours), "--address", cluster.address, "--out", str(out)]
        driver = subprocess.Popen(ours, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        raylet = victim.all_processes["raylet"][0].process.pid
        others = survivor.all_processes["raylet"][0].process.pid

        def flown():
            return out.read_text().count("\n") if out.exists() else 0

        def is_half_way_and_flying():
            assert driver.poll() is None, f"over before a node was killed: {driver.communicate()}"
            both = all("jink-campaign" in family(pid).values() for pid in (raylet, others))
            return flown() >= len(expected) // 3 and both

        until("a third of the flights and one on each node", is_half_way_and_flying)
        killed, done = family(raylet), flown()
        for pid in killed:
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                pass  # It went with its parent.
        in_flight = list(killed.values()).count("jink-campaign")
        assert in_flight == 1, killed
        print(f"killed {len(killed)} processes of a node after {done} of {len(expected)} flights, {in_flight} shard in the air", flush=True)
        printed, said = driver.communicate(timeout=PATIENCE_S)
        assert driver.returncode == alone.returncode, (driver.returncode, said)
        assert "missing" not in said and "given up" not in said, said
        assert printed.startswith("S3 with"), printed
        assert hashes(out) == expected, "other flights than without Ray"
        order = [(report["cell"], report["seed"]) for report in map(json.loads, out.read_text().splitlines())]
        assert order == sorted(order), "not in order"
        hash_lines = [[line.split()[1] for line in text.splitlines() if line.split()[:1] == ["hash"]] for text in (alone.stdout, printed)]
        assert hash_lines[0] == hash_lines[1] and len(hash_lines[0]) == 1, hash_lines

        before = out.read_bytes()
        again = subprocess.run(ours, capture_output=True, text=True)
        assert again.returncode == alone.returncode and out.read_bytes() == before, f"flown again: {again.stderr}"
        cluster.shutdown()
        print(printed, end="")
        print(f"{len(expected)} flights, each once, with the hashes of a plain run ({hash_lines[0][0]}); the second run flew none")


main()
