use super::*;
use rig_model::DriveMake;

use crate::device::drive::bench::Bench;

/// A controller that Modbus commands, with the servo on and home found.
fn ready() -> Bench {
    let mut bench = Bench::new(DriveMake::IaiRc);
    for coil in [coil::MODBUS_COMMANDS, coil::SERVO_ON, coil::HOME] {
        bench.coil(coil, true);
    }
    bench.coil(coil::HOME, false);
    bench.wait(5.0);
    assert_eq!(bench.read(monitor::STATUS_1, 1)[0] & status::HOMED, status::HOMED);
    bench
}

#[test]
fn a_move_starts_with_the_lower_word_of_its_target_and_one_read_tells_all() {
    let mut bench = ready();
    // 12.34 mm at 100 mm/s and 0.3 G, as one request.
    bench.write(order::POSITION, &[0, 1234, 0, 10, 0, 10_000, 30]);
    let words = bench.read(monitor::FIRST, 10);
    assert_eq!(words[7] & status::MOVING, status::MOVING);
    assert_eq!(words[5] & status::IN_POSITION, 0);
    bench.wait(1.0);
    let words = bench.read(monitor::FIRST, 10);
    assert_eq!((words[0], words[1], words[2]), (0, 1234, 0));
    assert_eq!(words[5] & status::IN_POSITION, status::IN_POSITION);
    assert_eq!(words[9], 0b1111);
    assert_eq!(bench.read_long(monitor::DEVIATION), 0);
    // The upper word alone starts nothing; the lower one does.
    bench.set(order::POSITION, 0);
    bench.wait(0.5);
    assert_eq!(bench.read_long(monitor::POSITION), 1234);
    bench.set(order::POSITION + 1, 2000);
    bench.wait(1.0);
    assert_eq!(bench.read_long(monitor::POSITION), 2000);
}

#[test]
fn increments_limits_and_refusals() {
    let mut bench = ready();
    bench.write(order::POSITION, &[0, 1000, 0, 10, 0, 10_000, 30]);
    bench.wait(1.0);
    bench.set(order::CONTROL, INCREMENTAL);
    bench.write(order::POSITION, &[0xFFFF, 0xFFFF - 99]);
    bench.wait(1.0);
    assert_eq!(bench.read_long(monitor::POSITION), 900);
    assert_eq!(bench.read(order::CONTROL, 1), [0], "the flags hold for one move");
    // Beyond the stroke of 50 mm it goes to 0.2 mm before its end.
    bench.write(order::POSITION, &[0, 6000]);
    bench.wait(3.0);
    assert_eq!(bench.read_long(monitor::POSITION), 4980);
    let too_far = Request::WriteRegisters { address: order::POSITION, values: vec![0x0F, 0x4240] };
    bench.refused(&too_far, Exception::Value);
    let elsewhere = Request::WriteRegister { address: 0x9000, value: 0 };
    bench.refused(&elsewhere, Exception::Address);
}

#[test]
fn without_home_a_move_is_an_alarm_and_the_reset_acts_when_it_is_released() {
    let mut bench = Bench::new(DriveMake::IaiRc);
    bench.write(order::POSITION, &[0, 100]);
    assert_eq!(bench.read(monitor::ALARM, 1), [0], "it is ignored without servo");
    bench.coil(coil::SERVO_ON, true);
    assert_eq!(bench.read(monitor::SYSTEM_STATUS, 2)[1], 1, "the terminals command");
    bench.coil(coil::MODBUS_COMMANDS, true);
    bench.coil(coil::SERVO_ON, true);
    bench.write(order::POSITION, &[0, 100]);
    assert_eq!(bench.read(monitor::ALARM, 1), [alarm::NO_HOME]);
    assert_eq!(bench.read(monitor::STATUS_1, 1)[0] & status::SERVO, 0);
    bench.coil(coil::ALARM_RESET, true);
    assert_eq!(bench.read(monitor::ALARM, 1), [alarm::NO_HOME]);
    bench.coil(coil::ALARM_RESET, false);
    assert_eq!(bench.read(monitor::ALARM, 1), [0]);
}

#[test]
fn a_pause_holds_the_move_and_a_stop_ends_it() {
    let mut bench = ready();
    bench.write(order::POSITION, &[0, 4000, 0, 10, 0, 2000, 30]);
    bench.wait(0.5);
    bench.coil(coil::PAUSE, true);
    bench.wait(1.0);
    let held = bench.read_long(monitor::POSITION);
    assert!((900..1200).contains(&held), "{held}");
    bench.coil(coil::PAUSE, false);
    bench.wait(5.0);
    assert_eq!(bench.read_long(monitor::POSITION), 4000);
    bench.write(order::POSITION, &[0, 0]);
    bench.wait(0.5);
    bench.coil(coil::STOP, true);
    bench.wait(5.0);
    let stopped = bench.read_long(monitor::POSITION);
    assert!((2500..3200).contains(&stopped), "{stopped}");
}

#[test]
fn the_status_can_be_read_as_bits_too() {
    let mut bench = ready();
    let bits = |bench: &mut Bench, address, count| match bench
        .ask(&Request::ReadDiscreteInputs(Block { address, count }))
    {
        Some(Ok(Reply::Bits(bits))) => bits,
        other => panic!("{other:?}"),
    };
    let register = bench.read(monitor::STATUS_1, 1)[0];
    let as_bits = bits(&mut bench, 0x0100, 16);
    let again = as_bits.iter().fold(0, |word, bit| word << 1 | u16::from(*bit));
    assert_eq!(again, register);
    bench.refused(&Request::ReadDiscreteInputs(Block { address: 0, count: 1 }), Exception::Address);
    let coils = Request::ReadCoils(Block { address: coil::SERVO_ON, count: 1 });
    assert_eq!(bench.ask(&coils), Some(Ok(Reply::Bits(vec![true]))));
}
