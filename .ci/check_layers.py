#!/usr/bin/python3
"""Fails when a file includes a layer above its own, ROS outside the ROS layers, or has grown too long.

The layers, bottom to top. A file may include its own layer and those of the lines before it; layers on the same line
know nothing of each other. docs/method.md says what each is for.
"""
import pathlib
import re
import sys

LEVELS = [
    ("geometry",),
    ("measurements",),
    ("sensors",),
    ("inertial",),
    ("visual", "lidar"),
    ("factors",),
    ("estimation",),
    ("initialization",),
    ("calibrators",),
    ("monitor",),
    ("io",),
    ("sim", "ros"),
    ("nodelets", "apps"),
]
LEVEL = {layer: level for level, layers in enumerate(LEVELS) for layer in layers}
WITH_ROS = ("ros", "nodelets", "apps")
ROS_HEADER = re.compile(
    r"#include\s*[<\"](ros|nodelet|pluginlib|class_loader|rosbag|roscpp|tf2\w*|cv_bridge|image_transport|diagnostic_updater|"
    r"dynamic_reconfigure|message_filters|pcl_ros|pcl_conversions|\w+_msgs|std_srvs|cocalib/[A-Z]\w*)[/.]")
OWN_HEADER = re.compile(r'#include "cocalib/(\w+)/')
MAX_LINES = 400


def layer_of(path):
    """The layer of include/cocalib/LAYER/..., src/LAYER/... and test/LAYER/..., or None."""
    return next((part for part in path.parts[1:-1] if part in LEVEL), None)


def errors_of(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    if len(lines) > MAX_LINES:
        yield f"{path}: {len(lines)} lines, more than {MAX_LINES}: split it"
    here = layer_of(path)
    if here is None:
        return
    for number, line in enumerate(lines, 1):
        included = OWN_HEADER.match(line)
        there = included[1] if included else None
        is_test = path.parts[0] == "test"  # may use the simulator and what reads its files, as users of the library
        if there in LEVEL and there != here and LEVEL[there] >= LEVEL[here] and not is_test:
            yield f"{path}:{number}: {here} may not include {there}"
        if ROS_HEADER.match(line) and here not in WITH_ROS:
            yield f"{path}:{number}: {here} may not include ROS"


def main():
    files = [path for root in ("include", "src", "test") for path in sorted(pathlib.Path(root).rglob("*"))
             if path.suffix in (".h", ".cpp")]
    errors = [error for path in files for error in errors_of(path)]
    print("\n".join(errors + [f"layers: {len(files)} files, {len(errors)} errors"]))
    return 1 if errors or not files else 0


if __name__ == "__main__":
    sys.exit(main())
