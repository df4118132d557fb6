"""Print constraints that pin what the package and its tests need to its lower bound."""

import re
import sys
import tomllib
from pathlib import Path

project = tomllib.loads(Path("pyproject.toml").read_text())["project"]
dependencies = [*project["dependencies"], *project["optional-dependencies"]["test"]]
for dependency in dependencies:
    name, lowest = re.fullmatch(r"([\w.-]+)>=([\w.]+)", dependency).groups()
    sys.stdout.write(f"{name}=={lowest}\n")
