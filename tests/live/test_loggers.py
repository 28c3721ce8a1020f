"""The manual's programs for a serial port and for UDP print the lines that a glove sends."""

import os
import re
import select
import signal
import socket
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "live.md"
FIRST_READINGS = range(500, 520)  # of the frames
FRAMES = [",".join(map(str, range(first, first + 1024))) for first in FIRST_READINGS]
LOCAL_MODES = 3  # index into what tcgetattr returns


def begun(library, folder, *words):
    """Start the manual's program that imports a library."""
    programs = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    (program,) = (text for text in programs if f"\nimport {library}\n" in text)
    (folder / "program.py").write_text(program)
    command = [sys.executable, str(folder / "program.py"), *words]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True)


def has_printed(process, seconds):
    """Return whether the program prints within some seconds.

    The output so far must have been read.
    """
    return bool(select.select([process.stdout], [], [], seconds)[0])


def until_heard(process, send):
    """Send until the program prints, since nobody listens before that."""
    while not has_printed(process, 0.05):
        assert process.poll() is None, process.stderr.read()
        send()


def check_end(process):
    """Check that Ctrl-C ends the program without a message."""
    process.send_signal(signal.SIGINT)
    assert process.stderr.read() == "" and process.wait() == -signal.SIGINT


def test_lines_of_a_serial_port_are_printed_whole_but_for_the_first_which_may_be_cut(tmp_path):
    pytest.importorskip("serial", reason="pyserial is not installed")
    glove, computer = os.openpty()
    with begun("serial", tmp_path, os.ttyname(computer)) as process:
        while termios.tcgetattr(computer)[LOCAL_MODES] & termios.ECHO:
            assert process.poll() is None, process.stderr.read()
            time.sleep(0.01)
        time.sleep(0.2)  # pyserial has opened the port and drops what came before
        os.write(glove, b"98.7,512\r\n1,2,3\r\n")
        assert process.stdout.readline() == "1,2,3\n"
        for frame in FRAMES:
            os.write(glove, frame[:100].encode())
            if frame == FRAMES[0]:
                assert not has_printed(process, 0.2)  # half a line is no frame
            os.write(glove, frame[100:].encode() + b"\r\n")
            assert process.stdout.readline() == f"{frame}\n"
        check_end(process)
    os.close(glove)
    os.close(computer)


def test_a_datagram_is_a_line(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        address = probe.getsockname()
    with (
        begun("socket", tmp_path, str(address[1])) as process,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as glove,
    ):
        until_heard(process, lambda: glove.sendto(b"1,2,3", address))
        glove.sendto(b"end of the beginning", address)
        while process.stdout.readline() == "1,2,3\n":
            pass
        for frame in FRAMES:
            glove.sendto(frame.encode(), address)
            assert process.stdout.readline() == f"{frame}\n"
        check_end(process)


def test_a_program_ends_without_a_word_when_nobody_reads_its_lines(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        address = probe.getsockname()
    with (
        begun("socket", tmp_path, str(address[1])) as process,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as glove,
    ):
        until_heard(process, lambda: glove.sendto(b"1,2,3", address))
        process.stdout.close()
        glove.sendto(b"1,2,3", address)
        assert process.stderr.read() == "" and process.wait() == -signal.SIGPIPE
