"""What REP-149 asks of a package.xml of format 3, as a list of what is wrong with one."""

from __future__ import annotations

import re
from collections import Counter
from xml.etree import ElementTree as ET

REQUIRED = ("name", "version", "description", "maintainer", "license")
ONCE = ("name", "version", "description")
DEPENDENCIES = (
    "depend", "build_depend", "build_export_depend", "buildtool_depend", "buildtool_export_depend", "exec_depend",
    "test_depend", "doc_depend",
)  # fmt: skip
OTHERS = ("url", "author", "conflict", "replace", "group_depend", "member_of_group", "export")
BUILD_TYPES = ("ament_cmake", "ament_python", "cmake")
EMAIL = r"[a-zA-Z0-9._%+-]+@[a-zA-Z0-9.-]+\.[a-zA-Z]{2,6}"


def problems(text: str) -> list[str]:
    """Everything that is wrong; nothing if it is a valid package.xml of a package that colcon builds."""
    root = ET.fromstring(text)
    found = []
    if root.tag != "package" or root.get("format") != "3":
        found.append("the root is no <package format='3'>")
    tags = Counter(child.tag for child in root)
    found += [f"<{tag}> is missing" for tag in REQUIRED if not tags[tag]]
    found += [f"<{tag}> is there {tags[tag]} times" for tag in ONCE if tags[tag] > 1]
    found += [f"<{tag}> is not of REP-149" for tag in tags if tag not in (*REQUIRED, *DEPENDENCIES, *OTHERS)]

    def texts(*names: str) -> list[str]:
        return [(child.text or "").strip() for child in root if child.tag in names]

    found += [f"<{child.tag}> is empty" for child in root if child.tag != "export" and not (child.text or "").strip()]
    found += [f"name {name!r}" for name in texts("name") if not re.fullmatch(r"[a-z](?:_?[a-z0-9]+)+", name)]
    found += [f"version {v!r}" for v in texts("version") if not re.fullmatch(r"(0|[1-9]\d*)(\.(0|[1-9]\d*)){2}", v)]
    for maintainer in root.iter("maintainer"):
        if not re.fullmatch(EMAIL, maintainer.get("email", "")):
            found.append(f"maintainer's email {maintainer.get('email')!r}")
    for tag in DEPENDENCIES:
        found += [f"<{tag}> of {name} twice" for name, count in Counter(texts(tag)).items() if count > 1]
    for name in texts("depend"):
        if name in texts("build_depend", "build_export_depend", "exec_depend"):
            found.append(f"<depend> of {name}, and a part of it again")
    found += [f"depends on itself: {n}" for n in texts(*DEPENDENCIES) if n in texts("name")]
    types = [build_type.text for export in root.iter("export") for build_type in export.iter("build_type")]
    if len(types) != 1 or types[0] not in BUILD_TYPES:
        found.append(f"build types {types}")
    elif types[0] == "ament_cmake" and "ament_cmake" not in texts("buildtool_depend"):
        found.append("ament_cmake without <buildtool_depend>ament_cmake")
    generates = "rosidl_default_generators" in texts(*DEPENDENCIES)
    if generates != ("rosidl_interface_packages" in texts("member_of_group")):
        found.append("interfaces and <member_of_group>rosidl_interface_packages belong together")
    return found
