"""The manual's programs for a serial port and for UDP, each with what it is made for."""

import os
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "live.md"
FRAMES = [",".join(str(500 + number + sensor) for sensor in range(1024)) for number in range(50)]


def begun(library, folder, *words):
    """The manual's program that imports a library, begun."""
    programs = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    (program,) = (text for text in programs if f"\nimport {library}\n" in text)
    (folder / "program.py").write_text(program)
    return subprocess.Popen(
        [sys.executable, str(folder / "program.py"), *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def check_end(process):
    """Ctrl-C ends the program without a word."""
    process.send_signal(signal.SIGINT)
    assert process.stderr.read() == "" and process.wait() == -signal.SIGINT


def test_a_serial_port_s_lines_are_printed_whole_and_without_the_cut_first_one(tmp_path):
    pytest.importorskip("serial", reason="pyserial is not installed")
    glove, computer = os.openpty()
    name = os.ttyname(computer)
    with begun("serial", tmp_path, name) as process:
        # pyserial drops what came before it opened the port: the cut line comes until it is heard
        os.set_blocking(process.stdout.fileno(), False)
        printed = b""
        number = 0
        while b"\n" not in printed:
            os.write(glove, b"7,7\r\n")
            printed = os.read(process.stdout.fileno(), 10) if number else b""
            number += 1
    os.close(glove)
    os.close(computer)


def test_a_datagram_is_a_line(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with (
        begun("socket", tmp_path, str(port)) as process,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as glove,
    ):
        glove.connect(("127.0.0.1", port))
        check_end(process)
