#!/usr/bin/python3
"""Prints a calibration beside the truth of a simulated bag, with the error of every parameter.

usage: compare_to_truth.py CALIBRATION.yaml TRUTH.yaml [--max-rotation DEG] [--max-translation MM]

Errors are those of the pose tangent (docs/conventions.md): translation and rotation vector in the parent frame, that is the
IMU's for the camera and the lidar, and the lidar's for lidar_camera. With limits given, the exit status is 1 when the norm of
a rotation or translation error exceeds its limit or an estimate is missing; unusable files give 1 as well, wrong usage 2.
"""
import argparse
import sys

import numpy
import yaml


def rotation_matrix(xyzw):
    x, y, z, w = numpy.array(xyzw, dtype=float) / numpy.linalg.norm(xyzw)
    return numpy.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def rotation_vector(rotation):
    """The vector phi of length <= pi with Exp(phi) = rotation [rad]."""
    axis = numpy.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    sine, cosine = 0.5 * numpy.linalg.norm(axis), 0.5 * (numpy.trace(rotation) - 1.0)
    angle = numpy.arctan2(sine, cosine)
    if sine > 1e-9:
        return 0.5 * axis * angle / sine
    if cosine > 0.0:
        return 0.5 * axis
    # Half a turn: the axis is the eigenvector of eigenvalue 1; its sign does not matter.
    values, vectors = numpy.linalg.eigh(rotation)
    return numpy.pi * vectors[:, numpy.argmax(values)]


class Transform:
    def __init__(self, rotation, translation):
        self.rotation, self.translation = rotation, translation

    @staticmethod
    def of(node):
        return Transform(rotation_matrix(node["rotation_xyzw"]), numpy.array(node["translation"], dtype=float))

    def inverse(self):
        return Transform(self.rotation.T, -self.rotation.T @ self.translation)

    def __mul__(self, other):
        return Transform(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)


def load(path):
    try:
        with open(path, encoding="utf-8") as stream:
            content = yaml.safe_load(stream)
    except (OSError, yaml.YAMLError) as error:
        sys.exit(f"compare_to_truth.py: cannot read {path}: {error}")
    if not isinstance(content, dict):
        sys.exit(f"compare_to_truth.py: {path} is not a calibration or truth file")
    return content


def true_transform(truth, part):
    """The true transform of `part`, or None where the scenario has no such sensor."""
    if part == "lidar_camera":
        camera, lidar = true_transform(truth, "camera"), true_transform(truth, "lidar")
        return lidar.inverse() * camera if camera and lidar else None
    return Transform.of(truth[part][f"T_imu_{part}"]) if part in truth else None


def true_time_offset(truth, part):
    """The true time offset [s] of camera or lidar, or of the camera against the lidar."""
    if part == "lidar_camera":
        return true_time_offset(truth, "camera") - true_time_offset(truth, "lidar")
    return float(truth[part]["time_offset"])


def print_rows(names, estimate, truth, error, sigma, unit, scale):
    for name, e, t, d, s in zip(names, estimate, truth, error, sigma):
        print(f"  {name:<22}{e * scale:>12.4f}{t * scale:>12.4f}{d * scale:>+12.4f}{s * scale:>12.4f}  {unit}")


def compare(part, node, truth):
    """Prints one transform beside the truth; returns the norms of its errors (rotation [rad], translation [m])."""
    transform = "T_lidar_camera" if part == "lidar_camera" else f"T_imu_{part}"
    estimated, true = Transform.of(node[transform]), true_transform(truth, part)
    error_t = estimated.translation - true.translation
    error_r = rotation_vector(estimated.rotation @ true.rotation.T)
    sigma = node["sigma"]
    print(f"{transform:<24}{'estimate':>12}{'truth':>12}{'error':>12}{'1 sigma':>12}")
    print_rows([f"translation {axis}" for axis in "xyz"], estimated.translation, true.translation, error_t,
               sigma["translation"], "mm", 1e3)
    print_rows([f"rotation about {axis}" for axis in "xyz"], rotation_vector(estimated.rotation),
               rotation_vector(true.rotation), error_r, sigma["rotation"], "deg", 180.0 / numpy.pi)
    if "time_offset" in node:
        offset = true_time_offset(truth, part)
        print_rows(["time offset"], [node["time_offset"]], [offset], [node["time_offset"] - offset],
                   [sigma.get("time_offset", 0.0)], "ms", 1e3)
    rotation, translation = numpy.linalg.norm(error_r), numpy.linalg.norm(error_t)
    print(f"  -> off by {numpy.degrees(rotation):.4f} deg and {translation * 1e3:.3f} mm")
    for direction in node.get("unobservable") or []:
        print(f"  not observable: {direction}")
    print()
    return rotation, translation


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("calibration")
    parser.add_argument("truth")
    parser.add_argument("--max-rotation", type=float, metavar="DEG")
    parser.add_argument("--max-translation", type=float, metavar="MM")
    arguments = parser.parse_args()
    calibration, truth = load(arguments.calibration), load(arguments.truth)

    print(f"status: {calibration.get('status')}, from {float(calibration.get('duration') or 0.0):.1f} s of data")
    print("An error of rotation is that of the whole rotation, about the axes of the parent frame: not a difference of columns.\n")
    good = True
    try:
        for part in ("camera", "lidar", "lidar_camera"):
            if true_transform(truth, part) is None:
                continue
            if part not in calibration:
                print(f"{part}: not in {arguments.calibration}\n")
                good = False
                continue
            rotation, translation = compare(part, calibration[part], truth)
            good &= arguments.max_rotation is None or numpy.degrees(rotation) <= arguments.max_rotation
            good &= arguments.max_translation is None or translation * 1e3 <= arguments.max_translation
    except (KeyError, TypeError, ValueError) as error:
        sys.exit(f"compare_to_truth.py: {arguments.calibration} or {arguments.truth} lacks {error}")
    limited = arguments.max_rotation is not None or arguments.max_translation is not None
    return 0 if good or not limited else 1


if __name__ == "__main__":
    sys.exit(main())
