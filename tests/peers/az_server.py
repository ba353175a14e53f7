#!/usr/bin/env python3
"""Two drives of Oriental Motor's AZ series, played by a pymodbus server: as much of their register
map as a driver needs, from the maker's manual (HM-60262E) and from nothing of rigd.

Usage: az_server.py tcp | az_server.py serial PATH

Prints `listening PLACE`, and then each command that a drive was given. Two things go wrong: a move
of unit 1 upwards beyond 42000 steps ends in the alarm 0x30 (overload) on its way, as at something heavy, and
a move of unit 2 beyond 4500 steps is ignored without a word, as these drives do.
"""

import asyncio
import struct
import sys
import time

from pymodbus import FramerType
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

# Upper words of 32-bit values.
DIRECT_DATA, TRIGGER = 0x0058, 0x0066
INPUT, OUTPUT, ALARM = 0x007C, 0x007E, 0x0080
TEMPERATURES = 0x00F8
FEEDBACK, COMMAND = 0x0120, 0x0122
ALARM_RESET = 0x0180
GEAR_A, GEAR_B = 0x0380, 0x0382
LIMIT_ACTION, LIMIT_POSITIVE, LIMIT_NEGATIVE = 0x0386, 0x0388, 0x038A

HOME_END, READY, ALARMED, MOVE, IN_POSITION = 1 << 4, 1 << 5, 1 << 7, 1 << 13, 1 << 14
STOP, FREE = 1 << 5, 1 << 6
ABSOLUTE = 1
OVERLOAD, SOFTWARE_OVERTRAVEL = 0x30, 0x67

# Address of the first value and how many values there are.
MAP = [(DIRECT_DATA, 8), (INPUT, 3), (TEMPERATURES, 2), (FEEDBACK, 2), (ALARM_RESET, 1),
       (GEAR_A, 2), (LIMIT_ACTION, 3)]


class Drive:
    """One drive, whose motor runs at constant speed."""

    def __init__(self, unit, position):
        self.unit, self.alarm, self.stopped = unit, 0, False
        self.start = self.target = self.command = position
        self.speed, self.started, self.alarm_at = 1, 0.0, None
        self.limits = None

    def device(self):
        blocks = [SimData(at, count=n, values=0, datatype=DataType.INT32) for at, n in MAP]
        return SimDevice(self.unit, simdata=blocks, action=self.access)

    def position(self):
        distance = (time.monotonic() - self.started) * self.speed
        way = self.target - self.start
        return round(self.start + max(-distance, min(distance, way)))

    def halt(self):
        self.start = self.target = self.position()

    def is_moving(self):
        return self.position() != self.target

    async def access(self, _function, first, address, count, registers, written):
        def put(at, value):
            upper, lower = struct.unpack(">HH", struct.pack(">i", value))
            registers[at - first:at - first + 2] = [upper, lower]

        def get(at):
            return struct.unpack(">i", struct.pack(">HH", *registers[at - first:at - first + 2]))[0]

        if written is not None:
            before_reset = get(ALARM_RESET)
            registers[address - first:address - first + count] = written
            self.obey(get, range(address, address + count), before_reset)
        if self.alarm_at is not None and self.position() >= self.alarm_at:
            self.halt()
            self.alarm, self.alarm_at = self.overtaken, None
            self.command = self.target
        moving = self.is_moving()
        ready = not (moving or self.alarm or self.stopped)
        bits = [(HOME_END, True), (READY, ready), (ALARMED, self.alarm), (MOVE, moving)]
        put(OUTPUT, sum(bit for bit, is_on in [*bits, (IN_POSITION, not moving)] if is_on))
        put(ALARM, self.alarm)
        # Of driver and motor, in tenths of a degree.
        put(TEMPERATURES, 412)
        put(TEMPERATURES + 2, 365)
        # A revolution is 1000 · B / A steps.
        put(GEAR_A, 1)
        put(GEAR_B, 1)
        put(FEEDBACK, self.position())
        put(COMMAND, self.position() if moving else self.command)

    def obey(self, get, addresses, before_reset):
        if LIMIT_ACTION in addresses:
            limits = get(LIMIT_NEGATIVE), get(LIMIT_POSITIVE)
            self.limits = limits if get(LIMIT_ACTION) >= 0 else None
            self.say(f"limits {limits[0]} {limits[1]}")
        if INPUT + 1 in addresses:
            self.stopped = bool(get(INPUT) & (STOP | FREE))
            if self.stopped:
                self.halt()
                self.command = self.target
                self.say("stop")
        if ALARM_RESET in addresses and before_reset == 0 and get(ALARM_RESET) == 1:
            self.alarm = 0
            self.say("reset")
        # The trigger is the last item, and starts what came before it.
        if TRIGGER + 1 in addresses and get(TRIGGER) == 1:
            _, kind, target, speed = [get(DIRECT_DATA + 2 * item) for item in range(4)]
            self.say(f"move {kind} {target} {speed}")
            self.go(kind, target, speed)

    def go(self, kind, target, speed):
        is_ignored = self.unit == 2 and target > 4500
        if kind != ABSOLUTE or self.is_moving() or self.alarm or self.stopped or is_ignored:
            return
        self.start, self.started, self.speed = self.position(), time.monotonic(), speed
        self.target = self.command = target
        # A drive that stays within a few steps of where it stands lifts nothing.
        if self.unit == 1 and target > 42_000 and target - self.start > 10:
            self.alarm_at, self.overtaken = (self.start + target) // 2, OVERLOAD
        elif self.limits and target > self.limits[1]:
            self.alarm_at, self.overtaken = self.limits[1], SOFTWARE_OVERTRAVEL

    def say(self, what):
        print(f"unit {self.unit}: {what}", flush=True)


async def main():
    devices = [Drive(1, 40_000).device(), Drive(2, 0).device()]
    if sys.argv[1] == "tcp":
        server = ModbusTcpServer(devices, address=("127.0.0.1", 0))
        await server.listen()
        host, port = server.transport.sockets[0].getsockname()
        print(f"listening {host}:{port}", flush=True)
    else:
        server = ModbusSerialServer(
            devices, port=sys.argv[2], baudrate=115_200, parity="N", framer=FramerType.RTU)
        await server.listen()
        print(f"listening {sys.argv[2]}", flush=True)
    await server.serving


if __name__ == "__main__":
    asyncio.run(main())
