"""A ground station made of MAVSDK: finds the vehicle, reads it, tunes and reads component 196, and flies.

Everything happens over one UDP link to the gateway (first argument: its port). The last line on standard output is one JSON
object: for each step what MAVSDK's own interface said, or {"error": its exception}.
"""

import asyncio
import json
import os
import sys
import tempfile
import traceback

from mavsdk import ComponentType, Configuration
from mavsdk.asyncio import Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.component_metadata import ComponentMetadataAsync
from mavsdk.asyncio.plugins.ftp import FtpAsync
from mavsdk.asyncio.plugins.mission import MissionAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.component_metadata import MetadataType
from mavsdk.plugins.mission import MissionItem, MissionPlan
from mavsdk.plugins.param import ProtocolVersion
from mavsdk.plugins.action.action import ActionError

AVOIDANCE = 196
PATIENCE_S = 40.0


async def first(stream, is_it=lambda value: True):
    """The first value of a stream that is as wanted."""
    async for value in stream:
        if is_it(value):
            return value


async def refusal(call):
    """What MAVSDK calls the refusal; "taken" if there is none."""
    try:
        await call
        return "taken"
    except Exception as error:
        return getattr(getattr(error, "result", None), "name", repr(error))


class Flight:
    def __init__(self, sdk, vehicle):
        self.sdk = sdk
        self.vehicle = vehicle
        self.telemetry = TelemetryAsync(vehicle)
        self.action = ActionAsync(vehicle)

    async def discovers(self):
        """The system with all components of it."""
        while not {1, 191, AVOIDANCE} <= set(self.vehicle._system.component_ids()):
            await asyncio.sleep(0.1)
        raw = self.vehicle._system
        return {"system": raw.get_system_id(), "components": sorted(raw.component_ids()), "autopilot": raw.has_autopilot()}

    async def reads_telemetry(self):
        position = await first(self.telemetry.subscribe_position())
        mode = await first(self.telemetry.subscribe_flight_mode(), lambda mode: mode.name != "UNKNOWN")
        health = await first(self.telemetry.subscribe_health())
        # Only from a heartbeat on it is known.
        armed = await first(self.telemetry.subscribe_armed())
        return {
            "latitude_deg": position.latitude_deg,
            "relative_altitude_m": position.relative_altitude_m,
            "mode": mode.name,
            "armed": armed,
            "health": {name: value for name, value in vars(health).items() if isinstance(value, bool)},
        }

    async def reads_the_autopilots_parameters(self):
        param = ParamAsync(self.vehicle)
        return {"cruise_mps": await param.get_param_float("MPC_XY_CRUISE"), "avoid": await param.get_param_int("COM_OBS_AVOID")}

    async def tunes_our_component(self):
        param = ParamAsync(self.vehicle)
        # The binding takes every answer of this call for a refusal, also where the component is selected.
        await refusal(param.select_component(AVOIDANCE, ProtocolVersion.V1))
        every = await param.get_all_params()
        answers = {
            "all": {p.name: p.value for p in every.float_params + every.int_params},
            "integers": sorted(p.name for p in every.int_params),
            "before": await param.get_param_float("OA_SPD_MAX"),
        }
        await param.set_param_float("OA_SPD_MAX", 2.5)
        answers["after"] = await param.get_param_float("OA_SPD_MAX")
        await param.set_param_int("OA_BLOCKED", 2)
        answers["integer_after"] = await param.get_param_int("OA_BLOCKED")
        answers["out_of_range"] = await refusal(param.set_param_float("OA_SPD_MAX", 99.0))
        answers["unknown"] = await refusal(param.get_param_float("NOT_THERE"))
        answers["at_last"] = await param.get_param_float("OA_SPD_MAX")
        return answers

    async def reads_our_files(self):
        ftp = FtpAsync(self.vehicle)
        await ftp.set_target_compid(AVOIDANCE)
        listed = await ftp.list_directory("/")
        answers = {"listed": sorted(entry.name for entry in listed.entries)}
        for burst in (False, True):
            with tempfile.TemporaryDirectory() as folder:
                async for _ in ftp.download("/parameters.json", folder, burst):
                    pass
                with open(os.path.join(folder, "parameters.json"), encoding="utf-8") as file:
                    answers["burst" if burst else "piece by piece"] = json.load(file)
        return answers

    async def reads_our_metadata(self):
        metadata = ComponentMetadataAsync(self.vehicle)
        updates = metadata.subscribe_metadata_available()
        waits = asyncio.ensure_future(first(updates, lambda update: update.type == MetadataType.ALL_COMPLETED))
        await asyncio.sleep(0)
        await metadata.request_component(AVOIDANCE)
        await waits
        got = await metadata.get_metadata(AVOIDANCE, MetadataType.PARAMETER)
        return json.loads(got.json_metadata)

    async def flies(self):
        mission = MissionAsync(self.vehicle)
        here = await first(self.telemetry.subscribe_position())
        items = [
            MissionItem(
                latitude_deg=here.latitude_deg + north_m / 111_195.0,
                longitude_deg=here.longitude_deg,
                relative_altitude_m=2.5,
                is_fly_through=True,
            )
            for north_m in (6.0, 12.0)
        ]
        await mission.upload_mission(MissionPlan(items))
        back = await mission.download_mission()
        answers = {"up": len(items), "down": len(back.mission_items)}
        while True:
            try:
                await self.action.arm()
                break
            except ActionError:
                # A busy machine has made the avoidance late for a moment, and the autopilot does not arm without it.
                await asyncio.sleep(1.0)
        await first(self.telemetry.subscribe_armed(), bool)
        await self.action.takeoff()
        await first(self.telemetry.subscribe_position(), lambda p: p.relative_altitude_m > 1.5)
        await first(self.telemetry.subscribe_flight_mode(), lambda mode: mode.name == "HOLD")
        await mission.start_mission()
        progress = await first(mission.subscribe_mission_progress(), lambda p: p.current == p.total > 0)
        answers["flown"] = [progress.current, progress.total]
        there = await first(self.telemetry.subscribe_position())
        answers["north_m"] = (there.latitude_deg - here.latitude_deg) * 111_195.0
        await self.action.land()
        await first(self.telemetry.subscribe_armed(), lambda armed: not armed)
        return answers


async def main():
    port, steps = sys.argv[1], sys.argv[2:]
    found = {}
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as sdk:
        found["version"] = await sdk.version()
        await sdk.add_any_connection(f"udpout://127.0.0.1:{port}")
        vehicle = await sdk.first_autopilot(PATIENCE_S)
        flight = Flight(sdk, vehicle) if vehicle else None
        for step in steps:
            try:
                found[step] = await asyncio.wait_for(getattr(flight, step)(), 2.0 * PATIENCE_S)
            except BaseException:
                found[step] = {"error": traceback.format_exc()}
    print(json.dumps(found, default=str), flush=True)
    # Its threads need not be waited for.
    os._exit(0)


asyncio.run(main())
