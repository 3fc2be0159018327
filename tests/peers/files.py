"""Reads all files of component 196 with pymavlink's own client of the file transfer protocol.

The last line on standard output is one JSON object: `listed` = names and sizes, `files` = path, text, size and the checksum
that pymavlink's side computes, `refused` = what the client is answered about a file that does not exist.
"""

import json
import logging
import os
import sys
import tempfile
import zlib

os.environ["MAVLINK20"] = "1"
from pymavlink import mavftp, mavutil  # noqa: E402

AVOIDANCE = 196
# The client gives up by itself where the machine stands still for a while.
ATTEMPTS = 5


def main():
    logging.disable(logging.CRITICAL)
    port, paths = sys.argv[1], sys.argv[2:]
    master = mavutil.mavlink_connection(
        f"udpout:127.0.0.1:{port}", source_system=254, source_component=190, dialect="common"
    )
    # The gateway answers who has spoken.
    master.mav.heartbeat_send(mavutil.mavlink.MAV_TYPE_GCS, mavutil.mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4)
    client = mavftp.MAVFTP(master, 1, AVOIDANCE)
    listing = client.cmd_list(["/"])
    found = {"list_error": listing.error_code, "listed": {e.name: e.size_b for e in client.list_result}, "files": {}}
    with tempfile.TemporaryDirectory() as folder:
        for path in paths:
            here = os.path.join(folder, "file")
            for _ in range(ATTEMPTS):
                client.cmd_get([path, here])
                got = client.process_ftp_reply("OpenFileRO", timeout=90)
                if os.path.exists(here):
                    break
            with open(here, "rb") as file:
                data = file.read()
            os.remove(here)
            found["files"][path] = {
                "error": got.error_code,
                "text": data.decode(),
                "size": len(data),
                "crc": zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF,
            }
        client.cmd_get(["/etc/passwd", os.path.join(folder, "never")])
        found["refused"] = client.process_ftp_reply("OpenFileRO", timeout=20).error_code
        found["refused_made_a_file"] = os.path.exists(os.path.join(folder, "never"))
    print(json.dumps(found))


main()
