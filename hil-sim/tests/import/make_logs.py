"""Writes the workbooks and logs of the tests: with openpyxl 3, mcap 1, mcap-ros2-support 0.6 and
rosbags 0.11, each as its documentation shows.
"""

import datetime
import json
import pathlib
import shutil

import numpy as np
import openpyxl
from mcap.writer import CompressionType, Writer
from mcap_ros2.writer import Writer as RosWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

# A workbook as people make them: a first sheet of words; a title, a blank row, names, units.
book = openpyxl.Workbook()
book.active.title = "Info"
book.active.append(["Prüfstand 3", "Muskel 7"])
sheet = book.create_sheet("Messung")
sheet.append(["Messung vom 3. Mai"])
sheet.append([])
sheet.append(["Zeit", "Uhr", "Druck", "Weg", "Kraft", "Bemerkung"])
sheet.append(["ms", None, "bar", "mm", "V", None])
start = datetime.datetime(2026, 5, 3, 14, 30, 0)
for row in range(5):
    sheet.append(
        [
            10 * row,
            start + datetime.timedelta(seconds=0.5 * row),
            1.013 + 0.5 * row,
            None if row == 2 else 1.5 * row,
            0.25 * row,
            "a;b, \"c\"" if row == 1 else None,
        ]
    )
book.save("sheet.xlsx")

# Two topics at different rates, one of them with an object and an array.
FIRST_NS = 1_700_000_000_000_000_000
for name, compression in (("lz4.mcap", CompressionType.LZ4), ("zstd.mcap", CompressionType.ZSTD)):
    with open(name, "wb") as file:
        writer = Writer(file, compression=compression)
        writer.start()
        schema = writer.register_schema("any", "jsonschema", b'{"type": "object"}')
        rig = writer.register_channel("/rig", "json", schema)
        force = writer.register_channel("/force", "json", schema)
        for row in range(8):
            time_ns = FIRST_NS + row * 10_000_000
            message = {"p": {"bar": 1 + 0.25 * row}, "name": "x", "is_up": row > 3}
            writer.add_message(rig, time_ns, json.dumps(message).encode(), time_ns)
            if row % 2 == 0:
                # Every second one at the time of the other topic, the others 5 ms later.
                time_ns += 5_000_000 * (row % 4 // 2)
                message = {"newtons": [7.0, 2.0 * row]}
                writer.add_message(force, time_ns, json.dumps(message).encode(), time_ns)
        writer.finish()

HEADER = """std_msgs/Header header
float64[2] pressure
float32 contraction
string unit
geometry_msgs/Point[] points
uint8 flags
int64 count
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
"""
with open("ros2.mcap", "wb") as file:
    writer = RosWriter(file)
    schema = writer.register_msgdef("rig_msgs/msg/State", HEADER)
    for row in range(6):
        time_ns = FIRST_NS + row * 10_000_000
        message = {
            "header": {
                "stamp": {"sec": 1_700_000_000, "nanosec": row * 10_000_000},
                "frame_id": "rig" + "g" * row,
            },
            "pressure": [1e5 * row, 5e5],
            "contraction": 0.125 * row,
            "unit": "Pa",
            "points": [{"x": 1.0, "y": float(row), "z": 3.0}] * (row % 3),
            "flags": row,
            "count": -row,
        }
        writer.write_message("/state", schema, message, log_time=time_ns, publish_time=time_ns)
    writer.finish()

# A bag of the usual types, as `ros2 bag record --storage mcap` leaves them.
shutil.rmtree("bag", ignore_errors=True)
types = get_typestore(Stores.ROS2_JAZZY)
Joints = types.types["sensor_msgs/msg/JointState"]
Header = types.types["std_msgs/msg/Header"]
Time = types.types["builtin_interfaces/msg/Time"]
Pressure = types.types["sensor_msgs/msg/FluidPressure"]
with BagWriter(pathlib.Path("bag"), version=9, storage_plugin=StoragePlugin.MCAP) as bag:
    joints = bag.add_connection("/joint_states", Joints.__msgtype__, typestore=types)
    pressure = bag.add_connection("/muscle/pressure", Pressure.__msgtype__, typestore=types)
    for row in range(6):
        time_ns = FIRST_NS + row * 10_000_000
        header = Header(stamp=Time(sec=1_700_000_000, nanosec=row * 10_000_000), frame_id="a")
        message = Joints(
            header=header,
            name=["left", "right"],
            position=np.array([0.5, 0.01 * row]),
            velocity=np.array([]),
            effort=np.array([0.0, 30.0 + row]),
        )
        data = types.serialize_cdr(message, Joints.__msgtype__)
        bag.write(joints, time_ns, data)
        message = Pressure(header=header, fluid_pressure=101325.0 + 1e4 * row, variance=0.0)
        bag.write(pressure, time_ns, types.serialize_cdr(message, Pressure.__msgtype__))
shutil.move("bag/bag.mcap", "bag.mcap")
shutil.rmtree("bag")
