#!/usr/bin/env python3
"""Uses the simulated analyzers as programs of other makers do: with PyVISA over a socket and a
serial port, and with a plain socket.

Usage: scpi_peers.py RIG_SIM
"""

import cmath
import math
import os
import random
import socket
import struct
import sys
import time

import pyvisa

from bench import DEADLINE_S, Sim, check, equal, wait_for

IDENTITY = "HIOKI,IM3536,190512345,V1.21"
COMMAND_ERROR, EXECUTION_ERROR = 32, 16


def resource(manager, place, ending):
    """A PyVISA resource at `host, port`, or at the path of a serial port."""
    is_serial = isinstance(place, str)
    name = f"ASRL{place}::INSTR" if is_serial else "TCPIP::{}::{}::SOCKET".format(*place)
    opened = manager.open_resource(name, read_termination=ending, write_termination=ending)
    opened.timeout = 1000 * DEADLINE_S
    if is_serial:
        opened.baud_rate = 38400
        # A serial line knows of no clients: what the last one said or did not hear may be on it.
        resynchronise(opened, "opening the serial port")
    return opened


class Plain:
    """The same with nothing but a socket."""

    def __init__(self, place, ending):
        self.ending = ending.encode()
        self.socket = socket.create_connection(place, DEADLINE_S)
        self.lines = self.socket.makefile("rb")

    @property
    def timeout(self):
        return 1000 * self.socket.gettimeout()

    @timeout.setter
    def timeout(self, timeout_ms):
        self.socket.settimeout(timeout_ms / 1000)

    def write(self, text):
        self.socket.sendall(text.encode() + self.ending)

    def write_raw(self, data):
        self.socket.sendall(data)

    def read(self):
        line = self.lines.readline()
        check(line.endswith(self.ending), f"a line that ends in {self.ending}: {line}")
        return line[: -len(self.ending)].decode()

    def query(self, text):
        self.write(text)
        return self.read()

    def query_ascii_values(self, text):
        return [float(field) for field in self.query(text).split(",")]

    def close(self):
        self.lines.close()
        self.socket.close()

    def vanish(self):
        """As a computer does whose power fails: the connection is reset."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.close()


def identity_errors_and_status(client):
    client.write("*RST;*CLS;*ESE 0;*SRE 0")
    equal(client.query("*IDN?"), IDENTITY, "identity")
    rows = [
        (":FREQuency 200", 0),
        (":FREQency 200", COMMAND_ERROR),
        (":FREQuency", COMMAND_ERROR),
        (":SYSTem:ERRor?", COMMAND_ERROR),
        (":FREQuency 1", EXECUTION_ERROR),
        (":LEVel:VOLTage 5.1", EXECUTION_ERROR),
        (":AVERaging 257", EXECUTION_ERROR),
        # Without an external trigger there is nothing to trigger.
        ("*TRG", EXECUTION_ERROR),
    ]
    for line, events in rows:
        client.write(line)
        equal(int(client.query("*ESR?")), events, line)
    equal(float(client.query(":FREQuency?")), 200.0, "the frequency after refused ones")
    # The rest of a line after an error is ignored.
    client.write(":FREQuency 1;:AVERaging 7")
    equal(client.query(":AVERaging?;*ESR?"), "1;16", "after an error")
    # An enabled event is summed up in the status byte, until it is read.
    client.write("*ESE 32;*SRE 32")
    client.write("WRONG")
    equal(client.query("*STB?"), "96", "the status byte after a wrong command")
    equal(client.query("*ESR?"), "32", "the event")
    equal(client.query("*STB?"), "0", "the status byte after the event was read")
    client.write("*ESE 0;*SRE 0")
    equal(client.query("*OPC?;*ESR?"), "1;0", "operation complete")


def measurement(client):
    """The impedance at 140 Hz, in two forms of it."""
    client.write("*RST;*CLS;:TRIGger EXTernal;:SPEEd SLOW;:AVERaging 7;:FREQuency 140")
    client.write(":LEVel V;:LEVel:VOLTage 5;:TRIGger:DELay 1;:MEASure:VALid 0")
    client.write(":PARameter1 Z;:PARameter3 PHASE")
    began = time.monotonic()
    size, phase_deg = client.query_ascii_values("*TRG;:MEASure?")
    took_s = time.monotonic() - began
    # One second of delay and 140 cycles of 140 Hz; nobody is faster than time itself.
    check(2.0 <= took_s < 10.0, f"a measurement of two seconds took {took_s:.3f} s")
    client.write(":PARameter1 RS;:PARameter3 X")
    resistance, reactance = client.query_ascii_values("*TRG;:MEASure?")
    equal(client.query("*ESR?"), "0", "events of a measurement")
    polar, cartesian = cmath.rect(size, math.radians(phase_deg)), complex(resistance, reactance)
    # Each has noise of a seventieth of half a percent in each part.
    check(abs(polar / cartesian - 1) < 0.01, f"{polar} and {cartesian} are one impedance")
    check(-90 < phase_deg < 0, f"a piezoelectric sensor is a capacitor: {phase_deg}°")
    return cartesian


def resynchronise(client, what):
    """What a client does that does not know what was said before it: it ends the message, asks what
    no other question has the answer to, and reads until that comes."""
    timeout_ms, client.timeout = client.timeout, 3000
    for attempt in range(5):
        delay_s = f"{1 + attempt / 10:.4f}"
        client.write("")
        client.write("*CLS")
        client.write(f":TRIGger:DELay {delay_s};:TRIGger:DELay?")
        try:
            while client.read() != delay_s:
                pass
        except (pyvisa.VisaIOError, TimeoutError):
            continue
        client.timeout = timeout_ms
        return
    raise SystemExit(f"FAILED: never in step again after {what}")


def garbage(client):
    chance = random.Random(1)
    rows = [b"\x00", b"\xff" * 300, b"'\"", b"(@1,", b":FREQ 1e", b"*", b"A" * 5000]
    # Bytes that end no message, and begin no block or string, whose end would be waited for.
    rows += [bytes(b for b in chance.randbytes(200) if b not in b"\r\n#'\"") for _ in range(10)]
    for row in rows:
        client.write_raw(row)
        resynchronise(client, row[:20])
        equal(client.query("*IDN?"), IDENTITY, f"identity after {row[:20]}")
        client.write("*CLS")


def one_client_after_the_other(open_client):
    first = open_client()
    first.write("*RST;*CLS;:FREQuency 321")
    # It goes without having heard the answer.
    first.write("*IDN?")
    first.close()
    second = open_client()
    equal(float(second.query(":FREQuency?")), 321.0, "the second client's first answer")
    equal(second.query("*ESR?"), "0", "events that the first one left")
    second.close()


def vanish_in_a_message(open_client, vanish):
    client = open_client()
    client.write("*RST;*CLS")
    client.close()
    vanish(b":FREQ 1")
    after = open_client()
    equal(after.query("*ESR?"), "0", "half a message of another client was no message")
    after.write(":TRIGger EXTernal;:SPEEd SLOW;:TRIGger:DELay 1")
    equal(after.query("*ESR?"), "0", "settings")
    after.close()
    # In the middle of a measurement, and of hearing its answer.
    vanish(b"*TRG;:MEAS?\r\n")
    after = open_client()
    resynchronise(after, "a client that vanished while it measured")
    equal(after.query("*IDN?;*ESR?"), IDENTITY + ";0", "identity and events")
    after.close()


def hioki(rig_sim, manager):
    with Sim(rig_sim, "analyzer", "analyzer-tcp") as sim:
        ending = "\r\n"
        address, path = sim.address("analyzer-tcp"), sim.ports["analyzer"]

        def vanish_from_socket(data):
            client = Plain(address, ending)
            client.write_raw(data)
            client.vanish()

        def vanish_from_terminal(data):
            line = os.open(path, os.O_RDWR | os.O_NOCTTY)
            os.write(line, data)
            os.close(line)

        makers = [
            ("PyVISA, socket", lambda: resource(manager, address, ending), vanish_from_socket),
            ("PyVISA, serial", lambda: resource(manager, path, ending), vanish_from_terminal),
            ("plain socket", lambda: Plain(address, ending), vanish_from_socket),
        ]
        found = []
        for name, open_client, vanish in makers:
            client = open_client()
            identity_errors_and_status(client)
            found.append(measurement(client))
            garbage(client)
            client.close()
            one_client_after_the_other(open_client)
            vanish_in_a_message(open_client, vanish)
            print(f"IM3536 by {name}: {found[-1]:.0f} ohm at 140 Hz")
        several_clients(address)
        for impedance in found:
            check(abs(impedance / found[0] - 1) < 0.01, f"one sensor, and {found}")
        sim.say("fault analyzer overload")
        client = makers[0][1]()
        client.write("*RST;:TRIGger EXTernal;:MEASure:VALid 1")
        equal(client.query("*TRG;:MEASure?").split(",")[:2], ["2", "*" * 10], "an overload")
        client.close()


def several_clients(address):
    """A client that measures for long keeps no other from identifying the instrument."""
    busy, other = Plain(address, "\r\n"), Plain(address, "\r\n")
    busy.write("*RST;*CLS;:TRIGger EXTernal;:FREQuency 150;:MEASure:VALid 0;:TRIGger:DELay 3")
    busy.write("*TRG;:MEASure?;:FREQuency?")
    began = time.monotonic()
    equal(other.query("*IDN?"), IDENTITY, "identity while another client measures")
    check(time.monotonic() - began < 1, "identity comes at once")
    other.write(":FREQuency 160")
    equal(float(other.query(":FREQuency?")), 160.0, "a setting waits for the measurement")
    check(time.monotonic() - began > 2.5, "the setting came into the measurement")
    fields = busy.read().split(";")
    equal(len(fields[0].split(",")), 2, "the values of the measurement")
    busy.close()
    other.close()


def keysight(rig_sim, manager):
    with Sim(rig_sim, "analyzer-tcp", options=["--analyzer", "keysight-e4980a"]) as sim:
        client = resource(manager, sim.address("analyzer-tcp"), "\n")
        check(",E4980A," in client.query("*IDN?"), "an E4980A")
        client.write("*CLS")
        for line, number in [("FREQ 1", -222), ("FRQ 200", -113), ("FREQ 200,1", -108)]:
            client.write(line)
            check(client.query("*STB?") == "4", f"{line}: the error queue is not summed up")
            report = client.query("SYST:ERR?")
            check(report.startswith(f"{number},\""), f"{line}: {report}")
        check(client.query("SYST:ERR?").lstrip("+").startswith('0,"No error'), "no error is left")
        client.write("FUNC:IMP RX;FREQ 140;VOLT 1;APER LONG,4;:TRIG:SOUR BUS;:INIT:CONT ON")
        client.write("TRIG:IMM")
        first = client.query_ascii_values("FETC?")
        equal((len(first), first[2]), (3, 0.0), "fields and status of a reading")
        again = client.query_ascii_values("*TRG")
        ratio = complex(*again[:2]) / complex(*first[:2])
        check(abs(ratio - 1) < 0.05, f"two readings of one sensor: {first}, {again}")
        # FETC? while nothing was triggered answers the last reading once more.
        equal(client.query_ascii_values("FETC?"), again, "the last reading")
        client.write("*RST")
        equal(float(client.query("FREQ?")), 1000.0, "the frequency after *RST")
        sim.say("fault analyzer reboot")
        client.write("*IDN?")
        client.close()

        def awake():
            client = resource(manager, sim.address("analyzer-tcp"), "\n")
            client.timeout = 200
            try:
                return client.query("*IDN?")
            except pyvisa.VisaIOError:
                return None
            finally:
                client.close()

        wait_for("the analyzer to boot", awake)
        print("E4980A by PyVISA: errors, status, readings and a reboot")


def main():
    manager = pyvisa.ResourceManager("@py")
    hioki(sys.argv[1], manager)
    keysight(sys.argv[1], manager)


if __name__ == "__main__":
    main()
