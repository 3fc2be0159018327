"""Signs messages with pymavlink and judges those that were signed elsewhere.

Reads one JSON object from standard input: `passphrase`, and `check`, a list of frames in hexadecimal digits. The last
line on standard output is one JSON object: `key` = the passphrase's key, `accepted` = for each frame whether pymavlink takes
it, `signed` = frames signed with the key on link 7.
"""

import hashlib
import io
import json
import sys

from pymavlink.dialects.v20 import common as mavlink


def connection(key):
    mav = mavlink.MAVLink(io.BytesIO(), srcSystem=255, srcComponent=190)
    mav.signing.secret_key = key
    mav.signing.link_id = 7
    mav.signing.sign_outgoing = True
    return mav


def takes(mav, frame):
    """Whether a whole frame comes out; a refused one raises an error."""
    try:
        messages = mav.parse_buffer(frame) or []
    except mavlink.MAVError:
        # What is left of it must not spoil the next one.
        mav.buf, mav.buf_index, mav.expected_length = bytearray(), 0, mavlink.HEADER_LEN_V1 + 2
        return False
    return len(messages) == 1 and messages[0].get_type() != "BAD_DATA"


def main():
    asked = json.load(sys.stdin)
    key = hashlib.sha256(asked["passphrase"].encode()).digest()
    receiver = connection(key)
    accepted = [takes(receiver, bytearray.fromhex(frame)) for frame in asked["check"]]
    sender = connection(key)
    sender.signing.timestamp = 10**12
    signed = [sender.attitude_encode(n, n, 0, 0, 0, 0, 0).pack(sender).hex() for n in range(20)]
    print(json.dumps({"key": key.hex(), "accepted": accepted, "signed": signed}))


main()
