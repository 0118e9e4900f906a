"""Writes the MATLAB files of the tests: with scipy 1 (version 5) and h5py 3 (version 7.3)."""

import zlib

import h5py
import numpy as np
import scipy.io

time_ms = np.arange(200) * 10.0
pressure_bar = (1 + np.sin(time_ms / 200)).reshape(-1, 1)
table = np.stack([time_ms, 100 * np.sin(time_ms / 300)], axis=1)
count = np.arange(200, dtype=np.int16)

for name, is_packed in (("plain5.mat", False), ("packed5.mat", True)):
    variables = {
        "t_ms": time_ms.reshape(1, -1),
        "p": pressure_bar,
        "data": table,
        "n": count,
        "note": "hello",
        "s": {"x": time_ms},
    }
    scipy.io.savemat(name, variables, do_compression=is_packed)


def variable(group, name, values, matlab_class=b"double", **how):
    found = group.create_dataset(name, data=values, **how)
    found.attrs["MATLAB_class"] = np.bytes_(matlab_class)


with h5py.File("v73.mat", "w", userblock_size=512) as file:
    variable(file, "t_ms", time_ms.reshape(-1, 1))
    variable(file, "p", pressure_bar.T, compression="gzip")
    variable(file, "data", table.T)
    variable(file, "n", count.reshape(1, -1), b"int16")
    variable(file, "note", np.array([[104], [105]], dtype=np.uint16), b"char")
    group = file.create_group("rig")
    group.attrs["MATLAB_class"] = np.bytes_(b"struct")
    variable(group, "p", pressure_bar.T)
# MATLAB's header stands before HDF5's.
header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 ."
with open("v73.mat", "r+b") as file:
    file.write(header.ljust(116) + b" " * 8 + b"\x00\x02IM")

# Links that lead back, and values that are nowhere.
with h5py.File("back.h5", "w") as file:
    group = file.create_group("a")
    group["root"] = file["/"]
    group["own"] = group
with h5py.File("filled.h5", "w") as file:
    file.create_dataset("t_ms", (1, 1_000_000_000), dtype="f8", chunks=(1, 1000), fillvalue=1.0)
# A million numbers under sixty names, and a chunk of 8000 bytes that unpacks to 20 MB.
with h5py.File("links.h5", "w") as file:
    zeros = np.zeros((1, 1_000_000))
    zeros = file.create_dataset("t_ms", data=zeros, compression="gzip", compression_opts=9)
    for number in range(60):
        file[f"x{number}"] = zeros
with h5py.File("bomb.h5", "w") as file:
    chunk = file.create_dataset("t_ms", (1, 1000), dtype="f8", chunks=(1, 1000), compression="gzip")
    chunk.id.write_direct_chunk((0, 0), zlib.compress(bytes(20_000_000), 9))
with h5py.File("one_dimension.h5", "w") as file:
    file["log/t"] = np.arange(4.0)
    file["log/force"] = np.arange(4, dtype=np.int16) ** 2
