"""``python no_sockets.py MODULE ARGUMENTS...`` runs a module in a process that ends as soon as it wants to the network.

By SIGSYS at the first connection or message that anything in it makes, by seccomp; by exit code 77 where Python looks
up a name or connects. A socket alone tells nobody anything: urllib3, which comes with open3d, tries one when imported.
"""

import ctypes
import os
import platform
import runpy
import struct
import sys

WATCHED = {"x86_64": (0xC000003E, 44, (42, 46, 307)), "aarch64": (0xC00000B7, 206, (203, 211, 269))}
"""Kinds of machines; the numbers there of the call `sendto`, and of `connect`, `sendmsg` and `sendmmsg`."""
LOOKED_UP = 77
_LOAD, _EQUAL, _RETURN = 0x20, 0x15, 0x06  # of a word; jump where equal; end
_ALLOW, _KILL = 0x7FFF0000, 0x80000000
_CALL, _MACHINE, _ADDRESS = 0, 4, 48  # places of words in what a filter sees; the last one is of `sendto`


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("steps", ctypes.c_char_p))


def can_watch() -> bool:
    """Whether this system can."""
    return platform.system() == "Linux" and platform.machine() in WATCHED


def watch() -> None:
    """From now on: this thread and all that it starts."""
    machine, sendto, (connect, *send) = WATCHED[platform.machine()]
    steps = [
        (_LOAD, 0, 0, _MACHINE),
        (_EQUAL, 0, 7, machine),
        (_LOAD, 0, 0, _CALL),
        (_EQUAL, 6, 0, connect),
        (_EQUAL, 5, 0, send[0]),
        (_EQUAL, 4, 0, send[1]),
        (_EQUAL, 0, 2, sendto),
        (_LOAD, 0, 0, _ADDRESS),
        (_EQUAL, 0, 1, 0),  # none, as between the two ends of a pipe of sockets
        (_RETURN, 0, 0, _ALLOW),
        (_RETURN, 0, 0, _KILL),
    ]
    program = _Program(len(steps), b"".join(struct.pack("HBBI", *step) for step in steps))
    libc = ctypes.CDLL(None, use_errno=True)
    no_new_rights, set_seccomp, filters = 38, 22, 2
    if libc.prctl(no_new_rights, 1, 0, 0, 0) or libc.prctl(set_seccomp, filters, ctypes.byref(program), 0, 0):
        raise OSError(ctypes.get_errno(), "no seccomp here")


def hook(event: str, arguments: tuple[object, ...]) -> None:
    """End where Python looks up a name or connects."""
    if event.removeprefix("socket.") in ("connect", "getaddrinfo", "gethostbyname", "sendto", "sendmsg"):
        os.write(2, f"{event} {arguments[-1]!r}\n".encode())
        os._exit(LOOKED_UP)


if __name__ == "__main__":
    sys.addaudithook(hook)
    if can_watch():
        watch()
    sys.argv = sys.argv[1:]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
