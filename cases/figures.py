#!/usr/bin/env python3
"""Figures of the pages of the cases that are not a value in a file of a run, computed from its files. DIR is the folder
of the run.

    python3 cases/figures.py mean DIR COLUMN FROM TO     mean of a column of series.csv between two times, s
    python3 cases/figures.py cavity DIR REYNOLDS         velocity on the centre lines beside Ghia et al., as CSV
    python3 cases/figures.py heap DIR                    ends of the heap in the last frame, m
    python3 cases/figures.py below DIR HEIGHT FROM TO    grains that fall below a height, 1/s, between two times, s
    python3 cases/figures.py residence DIR               mean residence time of the tracer, s
"""

import csv
import struct
import sys
import xml.etree.ElementTree as tree
from bisect import bisect
from pathlib import Path

# U. Ghia, K. N. Ghia, C. T. Shin, J. Comput. Phys. 48, 387 (1982), for Re 100 and 400: u at x = 0.5 over y (Table I), v
# at y = 0.5 over x (Table II, without the misprint of Re 400 at 0.9063).
ALONG_Y = {
    0.0547: (-0.03717, -0.08186),
    0.0625: (-0.04192, -0.09266),
    0.0703: (-0.04775, -0.10338),
    0.1016: (-0.06434, -0.14612),
    0.1719: (-0.10150, -0.24299),
    0.2813: (-0.15662, -0.32726),
    0.4531: (-0.21090, -0.17119),
    0.5: (-0.20581, -0.11477),
    0.6172: (-0.13641, 0.02135),
    0.7344: (0.00332, 0.16256),
    0.8516: (0.23151, 0.29093),
    0.9531: (0.68717, 0.55892),
    0.9609: (0.73722, 0.61756),
    0.9688: (0.78871, 0.68439),
    0.9766: (0.84123, 0.75837),
}
ALONG_X = {
    0.0625: (0.09233, 0.18360),
    0.0703: (0.10091, 0.19713),
    0.0781: (0.10890, 0.20920),
    0.0938: (0.12317, 0.22965),
    0.1563: (0.16077, 0.28124),
    0.2266: (0.17507, 0.30203),
    0.2344: (0.17527, 0.30174),
    0.5: (0.05454, 0.05186),
    0.8047: (-0.24533, -0.38598),
    0.8594: (-0.22445, -0.44993),
    0.9063: (-0.16914, None),
    0.9453: (-0.10313, -0.22847),
    0.9531: (-0.08864, -0.19254),
    0.9609: (-0.07391, -0.15663),
    0.9688: (-0.05906, -0.12146),
}


def series(folder: Path, *columns: str) -> list[tuple[float, ...]]:
    """Columns of series.csv, row by row."""
    with open(folder / "series.csv", encoding="utf-8") as file:
        return [tuple(float(row[column]) for column in columns) for row in csv.DictReader(file)]


def frames(folder: Path, name: str) -> list[tuple[float, Path]]:
    """Times and files of the frames of a list such as grains.pvd."""
    sets = tree.parse(folder / name).getroot().iter("DataSet")
    return [(float(entry.get("timestep", "nan")), folder / entry.get("file", "")) for entry in sets]


def column(frame: Path, name: str) -> list[tuple[float, ...]]:
    """A column of numbers of a frame, as many per point or cell as it has components."""
    data = frame.read_bytes()
    begin = data.index(b"_", data.index(b"<AppendedData")) + 1
    header = tree.fromstring(data[: data.index(b"<AppendedData")] + b"</VTKFile>")
    (entry,) = (entry for entry in header.iter("DataArray") if entry.get("Name") == name)
    assert entry.get("type") == "Float64", f"{frame}: {name} is no column of Float64"
    begin += int(entry.get("offset", "0"))
    (size,) = struct.unpack_from("<Q", data, begin)
    return list(struct.iter_unpack(f"<{entry.get('NumberOfComponents')}d", data[begin + 8 : begin + 8 + size]))


def between(line: list[tuple[float, float]], place: float) -> float:
    """The value of a line of (place, value) at a place, linear between its points."""
    after = min(max(bisect([at for at, _ in line], place), 1), len(line) - 1)
    (x0, v0), (x1, v1) = line[after - 1], line[after]
    return v0 + (place - x0) / (x1 - x0) * (v1 - v0)


def mean(folder: Path, name: str, begin: float, end: float) -> None:
    values = [value for time, value in series(folder, "time_s", name) if begin <= time <= end]
    print(f"{sum(values) / len(values):.6g}")


def cavity(folder: Path, reynolds: int) -> None:
    k = {100: 0, 400: 1}[reynolds]
    frame = frames(folder, "fluid.pvd")[-1][1]
    nodes = list(zip(column(frame, "points"), column(frame, "velocity_m_per_s"), strict=True))
    out = csv.writer(sys.stdout, lineterminator="\n")
    out.writerow(["reynolds", "line", "place_m", "known_m_per_s", "scene_m_per_s", "difference_m_per_s"])
    for name, across, table in [("u at x = 0.5 over y", 0, ALONG_Y), ("v at y = 0.5 over x", 1, ALONG_X)]:
        line = sorted((at[1 - across], velocity[across]) for at, velocity in nodes if abs(at[across] - 0.5) < 1e-9)
        for place, values in table.items():
            if (known := values[k]) is not None:
                found = between(line, place)
                out.writerow([reynolds, name, place, known, f"{found:.5f}", f"{found - known:.5f}"])


def heap(folder: Path) -> None:
    """From the middle outwards, up to where the floor is bare for a diameter of the largest disc."""
    frame = frames(folder, "grains.pvd")[-1][1]
    radii = [radius for (radius,) in column(frame, "radius_m")]
    grains = zip(column(frame, "points"), radii, strict=True)
    spans = sorted((at[0] - radius, at[0] + radius) for at, radius in grains)
    gap, ends = 2 * max(radii), []
    for side in (1, -1):
        outwards = sorted((min(side * a, side * b), max(side * a, side * b)) for a, b in spans)
        end = 0.0
        for near, far in outwards:
            if far > 0:
                if near > end + gap:
                    break
                end = max(end, far)
        ends.append(side * end)
    print(f"right {ends[0]:.4f}\nleft {ends[1]:.4f}")


def below(folder: Path, height: float, begin: float, end: float) -> None:
    counts = []
    for time, frame in frames(folder, "grains.pvd"):
        if begin - 1e-9 <= time <= end + 1e-9:
            counts.append((time, sum(at[1] < height for at in column(frame, "points"))))
    (first, before), (last, after) = counts[0], counts[-1]
    print(f"{(after - before) / (last - first):.1f}")


def residence(folder: Path) -> None:
    names = "time_s", "convected_tracer_outflow_m2_per_s", "flux_outflow_m2_per_s"
    rows = [(time, 1 - out / flux if flux else 1.0) for time, out, flux in series(folder, *names)]
    pairs = zip(rows, rows[1:], strict=False)
    print(f"{sum((t1 - t0) * (c0 + c1) / 2 for (t0, c0), (t1, c1) in pairs):.4f}")


def main() -> None:
    match sys.argv[1:]:
        case ["mean", folder, name, begin, end]:
            mean(Path(folder), name, float(begin), float(end))
        case ["cavity", folder, reynolds]:
            cavity(Path(folder), int(reynolds))
        case ["heap", folder]:
            heap(Path(folder))
        case ["below", folder, height, begin, end]:
            below(Path(folder), float(height), float(begin), float(end))
        case ["residence", folder]:
            residence(Path(folder))
        case _:
            sys.exit(__doc__)


if __name__ == "__main__":
    main()
