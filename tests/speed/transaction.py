#!/usr/bin/env python3
"""Times one transaction through each library, in one run. See transaction.sh, which calls it.

Modbus: four registers are read from libmodbus's own server, `at once` one after the other, and
`paced` with a pause of 5 ms before each read. A pseudo-terminal has no line, so that nobody keeps
the silence between two frames there (1.75 ms); on a real line it is the standard's, not overhead.
What a library adds is its time less that of libmodbus.

Analyzer: one point is measured by rig-sim's IM3536. PyVISA sends the same messages as rigd.
"""

import os
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pyvisa
from pymodbus.client import ModbusSerialClient, ModbusTcpClient

from bench import DEADLINE_S, Program, Sim, check

COUNT = 200
PAUSE_US = 5000
# The libraries take turns, and the best turn of each counts: a machine has other things to do.
TURNS = 5


def say(name, times_us, verdict):
    row = "  ".join(f"{maker} {time_us:7.1f} us" for maker, time_us in times_us.items())
    print(f"{name:20} {row}   {verdict}", flush=True)


def first_line(*command):
    ended = subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, timeout=DEADLINE_S, check=False)
    check(ended.returncode == 0, f"{command}: {ended.stderr}")
    return ended.stdout.splitlines()


def median_us(act, pause_us):
    times = []
    for _ in range(COUNT):
        time.sleep(pause_us / 1e6)
        asked = time.perf_counter()
        act()
        times.append(time.perf_counter() - asked)
    return 1e6 * statistics.median(times)


def pymodbus_us(client, pause_us):
    check(client.connect(), f"{client} connects")

    def read():
        answer = client.read_holding_registers(0, count=4, device_id=1)
        check(answer.registers == [1000, 1001, 1002, 1003], f"{answer}")

    try:
        return median_us(read, pause_us)
    finally:
        client.close()


def modbus(programs):
    ours, libmodbus = programs / "speed", programs / "libmodbus-speed"

    def compare(framing, place, address, client):
        for name, pause_us in (("at once", 0), ("paced", PAUSE_US)):
            rounds = [(
                float(first_line(libmodbus, "ask", framing, place, COUNT, pause_us)[0]),
                float(first_line(ours, "bus", framing, address, COUNT, pause_us)[0]),
                pymodbus_us(client(), pause_us),
            ) for _ in range(TURNS)]
            raw, rigd, python = map(min, zip(*rounds))
            times = {"libmodbus": raw, "rigd": rigd, "pymodbus": python}
            share = (rigd - raw) / (python - raw)
            verdict = f"rigd adds {rigd - raw:.1f} us, {share:.3f} of what pymodbus adds"
            say(f"Modbus {framing}, {name}", times, verdict)

    with tempfile.TemporaryDirectory(prefix="peer-") as folder:
        ends = [Path(folder) / end for end in ("master", "device")]
        with Program("socat", *(f"pty,raw,echo=0,link={end}" for end in ends)) as cable:
            cable.wait_for("the cable", lambda _: all(end.exists() for end in ends))
            with Program(libmodbus, "serve", "rtu", ends[1]) as server:
                server.wait_for("the server", lambda output: "listening" in output)
                path = str(ends[0])
                compare("rtu", path, path, lambda: ModbusSerialClient(path, baudrate=115_200))
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with Program(libmodbus, "serve", "tcp", port) as server:
        server.wait_for("the server", lambda output: "listening" in output)
        compare("tcp", port, f"127.0.0.1:{port}", lambda: ModbusTcpClient("127.0.0.1", port=port))


def analyzer(programs, rig_sim):
    with Sim(rig_sim, "analyzer") as sim:
        path = sim.ports["analyzer"]
        ours, *messages = first_line(programs / "speed", "analyzer", path, COUNT)
        client = pyvisa.ResourceManager("@py").open_resource(
            f"ASRL{os.path.realpath(path)}::INSTR", read_termination="\r\n", write_termination="\r\n")
        client.timeout = 5000
        client.query("*IDN?")
        half = len(messages) // 2
        check(messages[:half] != messages[half:] and len(messages) % 2 == 0, f"two points: {messages}")
        turn = 0

        def measure():
            nonlocal turn
            turn = half - turn
            for message in messages[turn:turn + half]:
                client.query(message) if "?" in message else client.write(message)

        rigd, python = float(ours), median_us(measure, 0)
        verdict = f"rigd takes {rigd / python:.3f} of what pyvisa-py takes"
        say("IM3536, one point", {"rigd": rigd, "pyvisa-py": python}, verdict)
        client.close()
        print("  the messages of one point: " + " | ".join(messages[half:]))


def main():
    rig_sim, programs = sys.argv[1], Path(sys.argv[2])
    modbus(programs)
    analyzer(programs, rig_sim)


if __name__ == "__main__":
    main()
