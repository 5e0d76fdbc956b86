#!/usr/bin/env python3
"""Figures of the pages of the cases that are not a value in a file of a run, computed from its files. DIR is the folder
of the run.

    python3 cases/figures.py mean DIR COLUMN FROM TO     mean of a column of series.csv between two times, s
    python3 cases/figures.py cavity DIR REYNOLDS         velocity on the centre lines beside Ghia et al., as CSV
    python3 cases/figures.py heap DIR                    ends of the heap in the last frame, m
    python3 cases/figures.py slope DIR                   angle of both sides of the heap in the last frame, degrees
    python3 cases/figures.py below DIR HEIGHT FROM TO    grains that fall below a height, 1/s, between two times, s
    python3 cases/figures.py aside DIR X                 mean distance of the grains from x = X in each frame, m
    python3 cases/figures.py residence DIR               mean residence time of the tracer, s
"""

import csv
import math
import struct
import sys
import xml.etree.ElementTree as tree
from bisect import bisect
from pathlib import Path

# Velocities on the centre lines of the cavity, u first and then v, by U. Ghia, K. N. Ghia, C. T. Shin, J. Comput. Phys.
# 48, 387 (1982).
KNOWN = Path(__file__).parent / "cavity" / "centre-lines.csv"

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
    frame = frames(folder, "fluid.pvd")[-1][1]
    nodes = list(zip(column(frame, "points"), column(frame, "velocity_m_per_s"), strict=True))
    with open(KNOWN, encoding="utf-8") as file:
        known = [row for row in csv.DictReader(file) if int(row["reynolds"]) == reynolds]
    out = csv.DictWriter(sys.stdout, known[0], lineterminator="\n")
    out.writeheader()
    lines = {}
    for across, name in enumerate(dict.fromkeys(row["line"] for row in known)):
        line = ((at[1 - across], velocity[across]) for at, velocity in nodes if abs(at[across] - 0.5) < 1e-9)
        lines[name] = sorted(line)
    for row in known:
        found = between(lines[row["line"]], float(row["place_m"]))
        difference = found - float(row["known_m_per_s"])
        out.writerow({**row, "scene_m_per_s": f"{found:.5f}", "difference_m_per_s": f"{difference:.5f}"})


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


def slope(folder: Path) -> None:
    """Straight lines through the highest points over strips two mean diameters wide, from a fifth to four fifths of the
    way between the middle and the foot."""
    frame = frames(folder, "grains.pvd")[-1][1]
    radii = [radius for (radius,) in column(frame, "radius_m")]
    grains = list(zip(column(frame, "points"), radii, strict=True))
    strip, angles = 4 * sum(radii) / len(radii), []
    for side in (1, -1):
        top: dict[int, float] = {}
        for at, radius in grains:
            number = int(side * at[0] // strip)
            top[number] = max(top.get(number, 0.0), at[1] + radius)
        last = max(top)
        points = [((k + 0.5) * strip, y) for k, y in top.items() if 0.2 * last <= k <= 0.8 * last]
        x0, y0 = (sum(values) / len(points) for values in zip(*points, strict=True))
        steep = sum((x - x0) * (y - y0) for x, y in points) / sum((x - x0) ** 2 for x, _ in points)
        angles.append(math.degrees(math.atan(-steep)))
    print(f"right {angles[0]:.1f}\nleft {angles[1]:.1f}")


def below(folder: Path, height: float, begin: float, end: float) -> None:
    counts = []
    for time, frame in frames(folder, "grains.pvd"):
        if begin - 1e-9 <= time <= end + 1e-9:
            counts.append((time, sum(at[1] < height for at in column(frame, "points"))))
    (first, before), (last, after) = counts[0], counts[-1]
    print(f"{(after - before) / (last - first):.1f}")


def aside(folder: Path, middle: float) -> None:
    for time, frame in frames(folder, "grains.pvd"):
        away = [abs(at[0] - middle) for at in column(frame, "points")]
        print(f"{time:g} {sum(away) / len(away):.3g}")


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
        case ["slope", folder]:
            slope(Path(folder))
        case ["below", folder, height, begin, end]:
            below(Path(folder), float(height), float(begin), float(end))
        case ["aside", folder, middle]:
            aside(Path(folder), float(middle))
        case ["residence", folder]:
            residence(Path(folder))
        case _:
            sys.exit(__doc__)


if __name__ == "__main__":
    main()
