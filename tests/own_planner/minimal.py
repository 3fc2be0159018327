"""The planner of src/minimal.rs in Python: straight to the goal, and where jink refuses that, past the place to blame."""

import math
import time

import jink
from foreign import Input, Output, Process

process = Process()
states, desires = Input(process, "vehicle/state"), Input(process, "vehicle/desired_path")
answers, output = Input(process, "plan/proposal_answer"), Output(process, "plan/proposal")
proposal, goal, tries, answered = jink.Proposal(), None, 0, 0
while not process.ends:
    begin_s = time.monotonic()
    state, desired, answer = states.fresh(), desires.fresh(), answers.fresh()
    if state and desired and desired[0].mode == jink.NavMode.MISSION:
        here, target = state[0].position, desired[0].points[1].position
        blame = None
        if answer and answer[0].proposal_id == proposal.id and answer[1].sequence != answered:
            answered = answer[1].sequence
            is_flown = answer[0].verdict in (jink.ProposalVerdict.ACCEPTED, jink.ProposalVerdict.SHORTENED)
            blame = None if is_flown else answer[0].place
        is_new = goal != (target.x_m, target.y_m, target.z_m)
        if math.isfinite(target.x_m) and (is_new or blame):
            goal, tries = (target.x_m, target.y_m, target.z_m), 0 if is_new else tries + 1
            north, east = target.x_m - here.x_m, target.y_m - here.y_m
            far = max(math.hypot(north, east), 0.1)
            # 0, -1, 1, -2, 2, ... times 0.8 m beside the place to blame.
            aside = 0.8 * ((tries % 11 + 1) // 2) * (1 - tries % 11 % 2 * 2)
            x, y = here.x_m + north / 2, here.y_m + east / 2
            if blame and math.isfinite(blame.x_m):
                x, y = blame.x_m, blame.y_m
            proposal = jink.Proposal(id=process.now_ns(), goal=target, len=3)
            way = [(here.x_m, here.y_m), (x - east / far * aside, y + north / far * aside), (target.x_m, target.y_m)]
            for waypoint, (north_m, east_m) in zip(proposal.waypoints, way):
                waypoint.x_m, waypoint.y_m, waypoint.z_m = north_m, east_m, target.z_m
        if proposal.len:
            output.send(proposal, state[1].capture)
    process.cycle(begin_s, jink.ServiceState.ACTIVE if state and desired else jink.ServiceState.STANDBY)
    process.wait(0.1)
process.stop()
