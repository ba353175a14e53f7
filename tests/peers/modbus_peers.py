#!/usr/bin/env python3
"""Uses the simulated drives as programs of other makers do: with pymodbus and with mbpoll
(libmodbus), over a serial port (8N1) and over TCP.

Usage: modbus_peers.py RIG_SIM
"""

import logging
import re
import struct
import subprocess
import sys
import time

import serial
from pymodbus import FramerType
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ModbusIOException

from bench import DEADLINE_S, Sim, check, equal, wait_for

LINEAR, ROTARY, NOBODY, EVERYBODY = 1, 2, 9, 0

# Oriental Motor AZ: the upper words of its values, and bits of its output.
DIRECT_DATA, ACCELERATION = 0x0058, 0x0060
INPUT, OUTPUT, ALARM = 0x007C, 0x007E, 0x0080
COMMAND_POSITION, FEEDBACK_POSITION = 0x00C6, 0x00CC
ALARM_RESET, LIMITS = 0x0180, 0x0386
HOME_END, READY, ALARMED, MOVE, IN_POSITION = 1 << 4, 1 << 5, 1 << 7, 1 << 13, 1 << 14
STOP = 1 << 5
SOFTWARE_OVERTRAVEL, OVERLOAD = 0x67, 0x30


def words(*values):
    """32-bit values as registers, the upper word first."""
    return list(struct.unpack(f">{2 * len(values)}H", struct.pack(f">{len(values)}i", *values)))


def longs(registers):
    return list(struct.unpack(f">{len(registers) // 2}i", struct.pack(f">{len(registers)}H", *registers)))


class PyModbus:
    """A pymodbus client that speaks of 32-bit values."""

    def __init__(self, client):
        self.client = client
        check(client.connect(), f"{client} connects")

    def read(self, unit, address):
        answer = self.client.read_holding_registers(address, count=2, device_id=unit)
        check(not answer.isError(), f"{address:#06x} of unit {unit}: {answer}")
        return longs(answer.registers)[0]

    def write(self, unit, address, *values):
        answer = self.client.write_registers(address, words(*values), device_id=unit)
        check(not answer.isError(), f"{address:#06x} of unit {unit}: {answer}")

    def start(self, unit, target, speed):
        """Direct data operation: absolute, then target, speed, ramps, current, trigger."""
        self.write(unit, DIRECT_DATA, 0, 1, target, speed, 1_000_000, 1_000_000, 1000, 1)

    def move(self, unit, target, speed):
        """Moves and returns the positions that were seen on the way, and how long it took."""
        self.start(unit, target, speed)
        began, seen = time.monotonic(), []

        def is_there():
            seen.append(self.read(unit, FEEDBACK_POSITION))
            return not self.read(unit, OUTPUT) & MOVE

        wait_for(f"the end of a move of unit {unit}", is_there)
        return seen, time.monotonic() - began


def motion(master):
    start, other = master.read(LINEAR, COMMAND_POSITION), master.read(ROTARY, COMMAND_POSITION)
    status = master.read(LINEAR, OUTPUT)
    equal(status & (HOME_END | READY | ALARMED | MOVE), HOME_END | READY, "status at rest")
    # One millimetre at two in a second.
    target = start - 1000 if start > 35_000 else start + 1000
    seen, took_s = master.move(LINEAR, target, 2000)
    check(0.4 < took_s < 5.0, f"a move of half a second took {took_s:.3f} s")
    on_the_way = [at for at in seen if 50 < abs(at - start) < 950]
    check(len(on_the_way) > 2, f"the axis was seen on its way: {seen}")
    equal(on_the_way, sorted(on_the_way, reverse=target < start), "it goes one way")
    equal(master.read(LINEAR, COMMAND_POSITION), target, "the command position at the end")
    off = master.read(LINEAR, FEEDBACK_POSITION) - target
    check(abs(off) <= 3, f"the encoder is {off} steps off")
    expected = HOME_END | READY | IN_POSITION
    equal(master.read(LINEAR, OUTPUT) & (expected | ALARMED | MOVE), expected, "status at the end")
    equal(master.read(ROTARY, COMMAND_POSITION), other, "the other axis did not move")


def alarms(master, sim):
    # The limit in the drive stops the move there and raises an alarm, which refuses further moves.
    at = master.read(LINEAR, COMMAND_POSITION)
    master.write(LINEAR, LIMITS, 3, at + 200, at - 200)
    master.move(LINEAR, at + 1000, 5000)
    equal(master.read(LINEAR, ALARM), SOFTWARE_OVERTRAVEL, "the alarm at the limit")
    equal(master.read(LINEAR, COMMAND_POSITION), at + 200, "where the limit stopped it")
    equal(master.read(LINEAR, OUTPUT) & (READY | ALARMED), ALARMED, "status in alarm")
    master.move(LINEAR, at, 5000)
    equal(master.read(LINEAR, COMMAND_POSITION), at + 200, "an alarm refuses moves")
    for value in (0, 1, 0):
        master.write(LINEAR, ALARM_RESET, value)
    master.write(LINEAR, LIMITS, -1, 0, 0)
    master.move(LINEAR, at, 5000)
    equal(master.read(LINEAR, COMMAND_POSITION), at, "after the reset it moves")
    # An alarm of the hardware stops the move that is under way.
    master.start(LINEAR, at - 20_000, 2000)
    sim.say(f"fault bus alarm code={OVERLOAD} unit={LINEAR}")
    wait_for("the motor to halt", lambda: not master.read(LINEAR, OUTPUT) & MOVE)
    equal(master.read(LINEAR, ALARM), OVERLOAD, "the alarm")
    check(at - 20_000 < master.read(LINEAR, FEEDBACK_POSITION), "it halted on its way")
    equal(master.read(ROTARY, ALARM), 0, "the other drive has none")
    for value in (0, 1, 0):
        master.write(LINEAR, ALARM_RESET, value)
    equal(master.read(LINEAR, ALARM), 0, "the alarm after its reset")
    master.move(LINEAR, at, 20_000)


def exceptions(master):
    client = master.client
    rows = [
        ("a function that the drive has not", 1, client.read_input_registers(0x00CC, count=2, device_id=1)),
        ("an address that it has not", 2, client.read_holding_registers(0x7000, count=2, device_id=1)),
        ("what can only be read", 2, client.write_registers(ALARM, [0, 0], device_id=1)),
        ("an acceleration of zero", 3, client.write_registers(ACCELERATION, [0, 0], device_id=1)),
        ("across the end of the map", 2, client.read_holding_registers(0xFFFF, count=2, device_id=1)),
    ]
    for what, code, answer in rows:
        equal((answer.isError(), getattr(answer, "exception_code", None)), (True, code), what)
    echo = client.diag_query_data(b"\x12\x34", device_id=1)
    check(not echo.isError() and echo.message == b"\x12\x34", f"the echo of diagnosis: {echo}")


def silence(master, is_serial):
    """Nobody answers for a unit that is not there, and nobody answers a broadcast, which is obeyed."""
    client = master.client
    patience, client.comm_params.timeout_connect = client.comm_params.timeout_connect, 0.3
    try:
        answer = client.read_holding_registers(FEEDBACK_POSITION, count=2, device_id=NOBODY)
        raise SystemExit(f"FAILED: unit {NOBODY} is not there and answers {answer}")
    except ModbusIOException:
        pass
    client.comm_params.timeout_connect = patience
    client.close()
    check(client.connect(), "connects again")
    if not is_serial:
        return
    target = master.read(LINEAR, COMMAND_POSITION) - 20_000
    master.start(LINEAR, target, 2000)
    for value in (STOP, 0):
        client.write_register(INPUT + 1, value, device_id=EVERYBODY, no_response_expected=True)
    wait_for("the motor to halt", lambda: not master.read(LINEAR, OUTPUT) & MOVE)
    check(target < master.read(LINEAR, FEEDBACK_POSITION), "the broadcast stopped it on its way")


def crc(frame):
    value = 0xFFFF
    for byte in frame:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return frame + struct.pack("<H", value)


def nothing_but_the_answer(path):
    """What comes after frames that nobody may answer is the answer to the one that somebody must."""
    ask = crc(bytes([LINEAR, 3, 0, ALARM, 0, 2]))
    answer = crc(bytes([LINEAR, 3, 4, 0, 0, 0, 0]))
    with serial.Serial(path, 115_200, timeout=5, exclusive=True) as line:
        wait_for("the line", lambda: line.write(ask) and line.read(len(answer)) == answer)
        rows = [
            crc(bytes([NOBODY, 3, 0, ALARM, 0, 2])),
            crc(bytes([EVERYBODY, 6, 0, INPUT + 1, 0, 0])),
            # Nobody reads by broadcast either.
            crc(bytes([EVERYBODY, 3, 0, ALARM, 0, 2])),
            # What a broadcast refuses, it refuses without a word.
            crc(bytes([EVERYBODY, 6, 0x70, 0, 0, 0])),
            # A reply of another drive on the line.
            crc(bytes([NOBODY, 3, 4, 0, 0, 0, 0])),
        ]
        for frame in rows:
            line.write(frame)
            time.sleep(0.025)  # The silence that ends a frame, as the line itself needs it.
            line.write(ask)
            equal(line.read(len(answer)), answer, f"the answer after {frame.hex(' ')}")
        damaged = bytearray(ask)
        damaged[3] ^= 1
        line.write(damaged)
        time.sleep(0.025)
        line.write(ask)
        equal(line.read(len(answer)), answer, "the answer after a damaged frame")


def mbpoll(*arguments):
    """What mbpoll prints, and its exit code."""
    command = ["mbpoll", "-0", "-1", "-o", "2", *map(str, arguments)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE_S, check=False)
    return ended.stdout + ended.stderr, ended.returncode


def by_mbpoll(place):
    def read(unit, address):
        output, code = mbpoll("-a", unit, "-r", address, "-c", 1, "-t", "4:int", "-B", *place)
        found = re.search(rf"^\[{address}\]:\s+(-?\d+)", output, re.MULTILINE)
        check(code == 0 and found, f"mbpoll reads {address:#06x}: {output}")
        return int(found[1])

    def write(unit, address, *values):
        output, code = mbpoll("-a", unit, "-r", address, "-t", "4:int", "-B", *place, "--", *values)
        check(code == 0, f"mbpoll writes {address:#06x}: {output}")

    at = read(LINEAR, COMMAND_POSITION)
    target = at - 500 if at > 35_000 else at + 500
    write(LINEAR, DIRECT_DATA, 0, 1, target, 5000, 1_000_000, 1_000_000, 1000, 1)
    wait_for("the end of a move", lambda: not read(LINEAR, OUTPUT) & MOVE)
    equal(read(LINEAR, COMMAND_POSITION), target, "the target by mbpoll")
    rows = [
        ("Illegal function", ["-a", 1, "-r", 204, "-t", "3:hex"]),
        ("Illegal data address", ["-a", 1, "-r", 0x7000, "-t", "4:hex"]),
        ("Connection timed out", ["-a", NOBODY, "-r", 204, "-t", "4:hex"]),
    ]
    for what, arguments in rows:
        output, _ = mbpoll(*arguments, *place)
        check(what in output, f"mbpoll says {what}: {output}")


def oriental_az(rig_sim):
    with Sim(rig_sim, "bus", "bus-tcp", "bus-rtu-tcp") as sim:
        path = sim.ports["bus"]
        (host, port), (_, rtu_port) = sim.address("bus-tcp"), sim.address("bus-rtu-tcp")
        patience = {"timeout": 5, "retries": 3}
        serial_port = dict(port=path, baudrate=115_200, parity="N", **patience)
        masters = [
            ("serial port", lambda: ModbusSerialClient(**serial_port)),
            ("Modbus TCP", lambda: ModbusTcpClient(host, port=port, **patience)),
            ("RTU over TCP", lambda: ModbusTcpClient(host, port=rtu_port, framer=FramerType.RTU, **patience)),
        ]
        for name, connect in masters:
            master = PyModbus(connect())
            motion(master)
            alarms(master, sim)
            exceptions(master)
            silence(master, name != "Modbus TCP")
            master.client.close()
            print(f"oriental-az by pymodbus, {name}: motion, alarms, exceptions, silence")
        nothing_but_the_answer(path)
        by_mbpoll(["-m", "tcp", "-p", port, host])
        by_mbpoll(["-m", "rtu", "-b", 115200, "-P", "none", path])
        print("oriental-az by mbpoll, serial port and Modbus TCP: motion, exceptions, silence")
        truth = sim.truth()
        equal(truth["contact"], "no", "nothing was touched")


def iai_and_leadshine(rig_sim):
    """Two drives of other makers on one line: an IAI under the linear stage, in 0.01 mm, and a
    Leadshine under the rotary one, in 0.01°."""
    options = ["--linear", "iai-rc", "--mm-per-step", "0.01", "--rotary", "leadshine-pr"]
    with Sim(rig_sim, "bus", "bus-tcp", options=options) as sim:
        host, port = sim.address("bus-tcp")
        for client in (ModbusSerialClient(sim.ports["bus"], baudrate=115_200, timeout=5),
                       ModbusTcpClient(host, port=port, timeout=5)):
            check(client.connect(), f"{client} connects")
            iai(client)
            leadshine(client)
            client.close()
        print("iai-rc and leadshine-pr by pymodbus, serial port and Modbus TCP: motion, exceptions")


def iai(client):
    def take(answer):
        check(not answer.isError(), f"iai-rc: {answer}")
        return answer

    def look():
        """Position, alarm, status 1 and extended status, as one query reads them."""
        read = take(client.read_holding_registers(0x9000, count=10, device_id=LINEAR)).registers
        return longs(read[:2])[0], read[2], read[5], read[7]

    for coil in (0x0427, 0x0403):
        take(client.write_coil(coil, True, device_id=LINEAR))
    servo_on, home_end, moving = 1 << 12, 1 << 4, 1 << 5
    wait_for("the servo", lambda: look()[2] & servo_on)
    if not look()[2] & home_end:
        for value in (False, True, False):
            take(client.write_coil(0x040B, value, device_id=LINEAR))
        wait_for("the end of homing", lambda: look()[2] & home_end)
    at, target = look()[0], 3800 if look()[0] != 3800 else 3700
    # Position, band, speed and acceleration; the lower word of the position starts the move, and
    # all of it arrives at once: 0.1 mm, 10 mm/s, 0.3 G.
    values = [*words(target, 10, 1000), 30]
    take(client.write_registers(0x9900, values, device_id=LINEAR))
    seen = []

    def is_there():
        position, alarm, _, extended = look()
        equal(alarm, 0, "the alarm of iai-rc")
        seen.append(position)
        return not extended & moving and abs(position - target) <= 10

    wait_for(f"a move of iai-rc from {at}", is_there)
    check(any(min(at, target) + 10 < p < max(at, target) - 10 for p in seen), f"on its way: {seen}")
    check(client.read_coils(0x0403, count=1, device_id=LINEAR).bits[0], "the coil of the servo")
    refused = client.read_holding_registers(0x7000, count=2, device_id=LINEAR)
    equal(refused.exception_code, 2, "an address that iai-rc has not")


def leadshine(client):
    def take(answer):
        check(not answer.isError(), f"leadshine-pr: {answer}")
        return answer

    def read(address, count):
        return take(client.read_holding_registers(address, count=count, device_id=ROTARY)).registers

    take(client.write_register(0x000F, 1, device_id=ROTARY))
    at = longs(read(0x602C, 2))[0]
    target = at + 1000
    # Path 0: absolute, position, rpm, acceleration, deceleration, pause, and run it.
    values = [1, *words(target), 30, 100, 100, 0, 0x0010]
    take(client.write_registers(0x6200, values, device_id=ROTARY))
    seen = []

    def is_there():
        fault, running, path_done = 1 << 0, 1 << 2, 1 << 5
        status = read(0x1003, 1)[0]
        check(not status & fault, f"leadshine-pr: alarm {read(0x2203, 1)[0]:#x}")
        seen.append(longs(read(0x602C, 2))[0])
        return not status & running and status & path_done

    wait_for(f"a move of leadshine-pr from {at}", is_there)
    check(abs(longs(read(0x602C, 2))[0] - target) <= 3, f"the end of a move to {target}")
    check(any(at + 10 < p < target - 10 for p in seen), f"on its way: {seen}")
    refused = client.read_coils(0, count=1, device_id=ROTARY)
    equal(refused.exception_code, 1, "a function that leadshine-pr has not")


def main():
    # What pymodbus complains of is asked for here.
    logging.disable(logging.CRITICAL)
    oriental_az(sys.argv[1])
    iai_and_leadshine(sys.argv[1])


if __name__ == "__main__":
    main()
