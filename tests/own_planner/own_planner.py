"""The planner of src/main.rs in Python: it proposes a way around the trees, which the planner of jink certifies."""

import itertools
import math
import time

import jink
from foreign import Input, Output, Process

# The two places are so far ahead at most, the second twice as far (m): with a third of the way left each.
AHEAD_M = 4.0
# How far beside the straight line they may lie: steps to either side, and their length (m).
ASIDE = range(-8, 9)
ASIDE_M = 0.75
# Cells above and below that count, and cells that are kept away from what stands.
HEIGHT = 4
DISTANCE = 4
# How often it looks: the map comes ten times a second.
PERIOD_S = 0.02

CELL_M, SIZE_X, SIZE_Y, SIZE_Z = (getattr(jink.LocalMap, name) for name in ("CELL_M", "SIZE_X", "SIZE_Y", "SIZE_Z"))
ALL = (1 << SIZE_X) - 1


class Slice:
    """What stands at the height of the flight, seen from above: a bit for each column that is too near to something."""

    def __init__(self, local_map, z_m):
        self.min = list(local_map.min_cell)
        planes = bytes(local_map.occupied)
        middle = math.floor(z_m / CELL_M)
        heights = range(max(middle - HEIGHT, self.min[2]), min(middle + HEIGHT + 1, self.min[2] + SIZE_Z))
        standing = [0] * SIZE_Y
        for z, row in itertools.product(heights, range(SIZE_Y)):
            at = ((z % SIZE_Z) * SIZE_Y + (self.min[1] + row) % SIZE_Y) * SIZE_X // 8
            standing[row] |= int.from_bytes(planes[at : at + SIZE_X // 8], "little")
        for row, bits in enumerate(standing):
            for n in range(1, DISTANCE + 1):
                standing[row] |= bits << n | bits >> SIZE_X - n | bits >> n | bits << SIZE_X - n
            standing[row] &= ALL
        self.rows = [0] * SIZE_Y
        for row in range(SIZE_Y):
            for bits in standing[max(row - DISTANCE, 0) : row + DISTANCE + 1]:
                self.rows[row] |= bits

    def is_free(self, x_m, y_m):
        """What lies beyond the map is free until it is seen."""
        x, row = math.floor(x_m / CELL_M), math.floor(y_m / CELL_M) - self.min[1]
        inside = 0 <= row < SIZE_Y and 0 <= x - self.min[0] < SIZE_X
        return not inside or not self.rows[row] >> x % SIZE_X & 1

    def is_clear(self, way, here, goal):
        """Whether nothing stands on the part of `way` that is still ahead of `here` on the way to `goal`."""
        north, east = goal[0] - here[0], goal[1] - here[1]
        for (x0, y0), (x1, y1) in itertools.pairwise(way):
            steps = max(1, math.ceil(math.hypot(x1 - x0, y1 - y0) / CELL_M))
            for step in range(steps + 1):
                x, y = x0 + (x1 - x0) * step / steps, y0 + (y1 - y0) * step / steps
                if (x - here[0]) * north + (y - here[1]) * east >= 0 and not self.is_free(x, y):
                    return False
        return True


def find_way(obstacles, here, goal):
    """The shortest way that is clear, or None."""
    north, east = goal[0] - here[0], goal[1] - here[1]
    far = max(math.hypot(north, east), 0.1)
    north, east, ahead = north / far, east / far, min(AHEAD_M, far / 3)

    def place(ahead, aside):
        return here[0] + north * ahead - east * aside, here[1] + east * ahead + north * aside

    ways = [
        [here, place(ahead, first * ASIDE_M), place(2 * ahead, second * ASIDE_M), goal]
        for first, second in itertools.product(ASIDE, ASIDE)
    ]
    ways.sort(key=lambda way: sum(math.dist(*leg) for leg in itertools.pairwise(way)))
    return next((way for way in ways if obstacles.is_clear(way, here, goal)), None)


def wants_planning(desired):
    target, waypoint = desired.points[0], desired.points[1]
    numbers = [getattr(point.position, axis) for point in (target, waypoint) for axis in ("x_m", "y_m", "z_m")]
    # MAV_CMD of take-off and landing.
    is_level = not {target.command, waypoint.command} & {21, 22}
    return desired.mode == jink.NavMode.MISSION and is_level and all(map(math.isfinite, numbers))


def main():
    process = Process()
    maps, states = Input(process, "map/local"), Input(process, "vehicle/state")
    desires, output = Input(process, "vehicle/desired_path"), Output(process, "plan/proposal")
    way, way_goal, proposal, newest = None, None, jink.Proposal(), 0
    while not process.ends:
        begin_s = time.monotonic()
        inputs = [maps.fresh(view=True), states.fresh(), desires.fresh()]
        if all(inputs):
            (local_map, map_header), (state, _), (desired, _) = inputs
            if map_header.sequence != newest and wants_planning(desired):
                newest = map_header.sequence
                place = desired.points[1].position
                here, goal = (state.position.x_m, state.position.y_m), (place.x_m, place.y_m)
                obstacles = Slice(local_map, state.position.z_m)
                if way_goal != goal or way is None or not obstacles.is_clear(way, here, goal):
                    way, way_goal = find_way(obstacles, here, goal), goal
                    proposal = jink.Proposal(id=process.now_ns(), goal=place, len=4 if way else 0)
                    for waypoint, (x, y) in zip(proposal.waypoints, way or []):
                        waypoint.x_m, waypoint.y_m, waypoint.z_m = x, y, place.z_m
                if way:
                    output.send(proposal, map_header.capture)
        process.cycle(begin_s, jink.ServiceState.ACTIVE if all(inputs) else jink.ServiceState.STANDBY)
        # The map is the sample itself: it goes before the next one comes.
        inputs = local_map = map_header = None
        process.wait(PERIOD_S)
    process.stop()


if __name__ == "__main__":
    main()
