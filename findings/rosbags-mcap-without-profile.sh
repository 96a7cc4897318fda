#!/usr/bin/env bash
# rosbags refuses an MCAP file of ROS 2 messages whose header names no profile.
#
# Library: rosbags 0.11.9 (PyPI); the file is written, and read as well, by mcap 1.4.0.
# A good guess: the profile may be left empty, says the specification of MCAP ("This field may also be supplied empty"),
#   and every channel and schema says itself how its messages are encoded (cdr, ros2msg). So such a file is read.
# What happens: `Reader.open` raises ReaderError, whatever the channels are. With the profile "ros2" and nothing else
#   changed, the same messages are read.
# Seen:
#   rosbags 0.11.9
#   one message of std_msgs/msg/String, in cdr
#   expected: it is read, whatever the profile
#   seen:     profile 'ros2': 1 message
#   seen:     profile '': ReaderError: Profile is not ros2.
#   mcap reads 1 message of either
# In jaxmm: the reader of bags names the profile that it found and the one that it needs.
set -euo pipefail
VERSION=${VERSION:-0.11.9}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "rosbags==$VERSION" mcap==1.4.0
cat > check.py <<'PY'
import sys
from importlib.metadata import version
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore


def write(path: str, profile: str) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "std_msgs/msg/String"
    data = bytes(store.serialize_cdr(store.types[kind](data="told"), kind))
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start(profile=profile, library="check")
        schema = writer.register_schema(name=kind, encoding="ros2msg", data=b"string data\n")
        channel = writer.register_channel(topic="/said", message_encoding="cdr", schema_id=schema)
        writer.add_message(channel_id=channel, log_time=1, publish_time=1, data=data)
        writer.finish()


print("rosbags", version("rosbags"))
print("one message of std_msgs/msg/String, in cdr")
print("expected: it is read, whatever the profile")
seen, others = {}, []
for profile in ("ros2", ""):
    path = f"a{profile}.mcap"
    write(path, profile)
    with open(path, "rb") as file:
        others.append(len(list(make_reader(file).iter_messages())))
    try:
        with Reader(Path(path)) as reader:
            told = f"{len(list(reader.messages()))} message"
    except Exception as error:
        told = f"{type(error).__name__}: {error}"
    seen[profile] = told
    print(f"seen:     profile {profile!r}: {told}")
print(f"mcap reads {others[0]} message of either" if others == [1, 1] else f"mcap reads {others}")
stated = seen["ros2"] == "1 message" and seen[""].startswith("ReaderError") and others == [1, 1]
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
