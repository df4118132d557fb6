"""Print constraints that pin every dependency of pyproject.toml to its lower bound."""

import re
import sys
import tomllib
from pathlib import Path

project = tomllib.loads(Path("pyproject.toml").read_text())["project"]
dependencies = [*project["dependencies"], *project["optional-dependencies"]["dev"]]
for dependency in dependencies:
    name, lowest = re.fullmatch(r"([\w.-]+)>=([\w.]+)", dependency).groups()
    sys.stdout.write(f"{name}=={lowest}\n")
