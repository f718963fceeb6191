#!/usr/bin/env python3
"""Draws docs/images/deskew.svg from a table of bench_deskew:

    bench_deskew --duration 40 --csv deskew.csv && bench/plot_deskew.py deskew.csv docs/images/deskew.svg
"""
import csv
import math
import sys

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 760, 380, 70, 20, 20, 50
LOW_MM, HIGH_MM = 10.0, 1000.0
LINES = [
    ("none_mm", "#c0504d", "no deskew"),
    ("deskew_mm", "#1f4e9c", "cocalib, calibrating from nothing"),
    ("true_mm", "#4c9a2a", "true calibration and motion: the noise of the ranges"),
]


def main():
    with open(sys.argv[1]) as table:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(table)]
    end_s = max(row["t_s"] for row in rows)

    def x(t_s):
        return LEFT + (WIDTH - LEFT - RIGHT) * t_s / end_s

    def y(mm):
        share = math.log(mm / LOW_MM) / math.log(HIGH_MM / LOW_MM)
        return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * share

    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}" '
           'font-family="sans-serif" font-size="12">', f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>']
    for mm in (10, 20, 50, 100, 200, 500, 1000):
        out.append(f'<path d="M{LEFT} {y(mm):.1f}H{WIDTH - RIGHT}" stroke="#dddddd"/>')
        out.append(f'<text x="{LEFT - 8}" y="{y(mm) + 4:.1f}" text-anchor="end">{mm}</text>')
    for t_s in range(0, int(end_s) + 1, 5):
        out.append(f'<text x="{x(t_s):.1f}" y="{HEIGHT - BOTTOM + 18}" text-anchor="middle">{t_s}</text>')
    out.append(f'<text x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 10}" text-anchor="middle">'
               'time since the begin of the motion [s]</text>')
    out.append(f'<text transform="translate(18 {(TOP + HEIGHT - BOTTOM) / 2}) rotate(-90)" text-anchor="middle">'
               'RMS distance to the true planes [mm]</text>')
    for number, (key, colour, words) in enumerate(LINES):
        points = [f'{x(row["t_s"]):.1f},{y(row[key]):.1f}' for row in rows if row[key] > 0.0]
        dash = ' stroke-dasharray="6 4"' if key == "true_mm" else ""
        out.append(f'<polyline points="{" ".join(points)}" fill="none" stroke="{colour}" stroke-width="2"{dash}/>')
        out.append(f'<path d="M{WIDTH - 370} {TOP + 14 + 18 * number}h28" stroke="{colour}" stroke-width="2"{dash}/>')
        out.append(f'<text x="{WIDTH - 336}" y="{TOP + 18 + 18 * number}">{words}</text>')
    out.append("</svg>")
    with open(sys.argv[2], "w") as image:
        image.write("\n".join(out) + "\n")


if __name__ == "__main__":
    main()
