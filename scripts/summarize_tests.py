#!/usr/bin/python3
"""Counts the test cases of gtest and rostest result files; the last line is 'N passed, N failed[, N skipped]'.

catkin_test_results counts a gtest file twice and a rostest wrapper as a test of its own, hence this.
Exit status 1 when a test failed, when ctest reported a failure that no file shows, or when nothing passed.
"""
import argparse
import pathlib
import sys
import xml.etree.ElementTree as ElementTree


def outcome(case):
    """'failed', 'skipped' or 'passed' and the first line of the message of one <testcase>."""
    for child in case:
        if child.tag in ("failure", "error"):
            text = (child.get("message") or child.text or "").strip()
            return "failed", text.splitlines()[0] if text else ""
    skip = case.find("skipped")
    if skip is not None or case.get("status") == "notrun" or case.get("result") in ("skipped", "suppressed"):
        text = ((skip.get("message") or skip.text or "") if skip is not None else "").strip()
        return "skipped", text.splitlines()[-1] if text else ""
    return "passed", ""


def cases(file):
    """(outcome, name, message) of every test case in a result file; a file that cannot be read is one failure."""
    try:
        root = ElementTree.parse(file).getroot()
    except ElementTree.ParseError as error:
        yield "failed", file.name, f"unreadable result file: {error}"
        return
    for case in root.iter("testcase"):
        result, message = outcome(case)
        # rostest writes one entry per <test> node; the cases of that node are in a rosunit-*.xml of their own.
        if file.name.startswith("rostest-") and result != "failed":
            continue
        yield result, f"{case.get('classname')}.{case.get('name')}", message


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("directory", type=pathlib.Path)
    parser.add_argument("--ctest-status", type=int, default=0)
    arguments = parser.parse_args()

    found = [case for file in sorted(arguments.directory.rglob("*.xml")) for case in cases(file)]
    count = {kind: sum(case[0] == kind for case in found) for kind in ("passed", "failed", "skipped")}
    for result, name, message in found:
        if result != "passed":
            print(f"{result.upper()} {name}{': ' if message else ''}{message}")
    if arguments.ctest_status and not count["failed"]:
        print("FAILED: ctest reports a failure that no result file shows; see its output above")
        count["failed"] = 1
    if not found:
        print("FAILED: no test ran")
    line = f"{count['passed']} passed, {count['failed']} failed"
    print(line + (f", {count['skipped']} skipped" if count["skipped"] else ""))
    return 0 if count["passed"] and not count["failed"] else 1


if __name__ == "__main__":
    sys.exit(main())
