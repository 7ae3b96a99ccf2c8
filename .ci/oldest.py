"""Print the oldest versions that pyproject.toml allows for a run, as constraints for pip."""

import re
import sys
import tomllib
from pathlib import Path

project = tomllib.loads(Path("pyproject.toml").read_text("utf-8"))["project"]
for line in (*project["dependencies"], *project["optional-dependencies"]["ros"]):
    sys.stdout.write(re.sub(r">=([^,]+).*", r"==\1.*", line) + "\n")
