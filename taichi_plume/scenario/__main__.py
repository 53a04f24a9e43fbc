"""``python -m taichi_plume.scenario --schema`` prints the JSON schema of scenarios, for editors."""

import json
import signal
import sys

from taichi_plume.guard.terminal import say
from taichi_plume.scenario.scenario import Scenario

if hasattr(signal, "SIGPIPE"):  # Windows has none
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # a reader such as `head` may leave early
if sys.argv[1:] != ["--schema"]:
    sys.exit("usage: python -m taichi_plume.scenario --schema")
say(json.dumps(Scenario.model_json_schema(), indent=2), longest=None)
