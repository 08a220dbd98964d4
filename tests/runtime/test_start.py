"""What a generated node loads when it starts."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from m2c.model import DiagnosticLog, load
from tests.codegen.files import node_modules

MODEL = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Echo" initial="idle" datamodel="ecmascript">
  <ros_topic_subscriber name="in" topic="/in" type="std_msgs/Int32"/>
  <ros_topic_publisher name="out" topic="/out" type="std_msgs/Int32"/>
  <state id="idle">
    <ros_topic_callback name="in" target="idle">
      <ros_topic_publish name="out"><field name="data" expr="_msg.data % 7"/></ros_topic_publish>
    </ros_topic_callback>
  </state>
</scxml>
"""

IMPORT = """
import sys
import echo.node, m2c.runtime.main
print(*sorted(name for name in sys.modules if name.partition(".")[0] == "lxml" or name.startswith("m2c.model")))
"""


def test_a_generated_node_starts_without_the_model_and_without_a_reader_of_xml(
    tmp_path: Path,
) -> None:
    model = tmp_path / "echo.scxml"
    model.write_text(MODEL)
    log = DiagnosticLog()
    system = load([model], log)
    assert system is not None
    assert not log.has_errors, log.diagnostics
    package = tmp_path / "echo"
    package.mkdir()
    for name, text in node_modules(system.nodes[0], system.library, "echo").items():
        (package / name).write_text(text)
    program = f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n{IMPORT}"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.strip() == ""
