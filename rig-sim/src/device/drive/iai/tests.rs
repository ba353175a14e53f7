use super::*;
use rig_model::DriveMake;

use crate::device::drive::test_drive::TestDrive;

/// A controller that Modbus commands, with the servo on and home found.
fn ready() -> TestDrive {
    let mut test_drive = TestDrive::new(DriveMake::IaiRc);
    for coil in [coil::MODBUS_COMMANDS, coil::SERVO_ON, coil::HOME] {
        test_drive.coil(coil, true);
    }
    test_drive.coil(coil::HOME, false);
    test_drive.wait(5.0);
    assert_eq!(test_drive.read(monitor::STATUS_1, 1)[0] & status::HOMED, status::HOMED);
    test_drive
}

#[test]
fn a_move_starts_with_the_lower_word_of_its_target_and_one_read_tells_all() {
    let mut test_drive = ready();
    // 12.34 mm at 100 mm/s and 0.3 G, as one request.
    test_drive.write(order::POSITION, &[0, 1234, 0, 10, 0, 10_000, 30]);
    let words = test_drive.read(monitor::FIRST, 10);
    assert_eq!(words[7] & status::MOVING, status::MOVING);
    assert_eq!(words[5] & status::IN_POSITION, 0);
    test_drive.wait(1.0);
    let words = test_drive.read(monitor::FIRST, 10);
    assert_eq!((words[0], words[1], words[2]), (0, 1234, 0));
    assert_eq!(words[5] & status::IN_POSITION, status::IN_POSITION);
    assert_eq!(words[9], 0b1111);
    assert_eq!(test_drive.read_long(monitor::DEVIATION), 0);
    // The upper word alone starts nothing; the lower one does.
    test_drive.set(order::POSITION, 0);
    test_drive.wait(0.5);
    assert_eq!(test_drive.read_long(monitor::POSITION), 1234);
    test_drive.set(order::POSITION + 1, 2000);
    test_drive.wait(1.0);
    assert_eq!(test_drive.read_long(monitor::POSITION), 2000);
}

#[test]
fn increments_limits_and_refusals() {
    let mut test_drive = ready();
    test_drive.write(order::POSITION, &[0, 1000, 0, 10, 0, 10_000, 30]);
    test_drive.wait(1.0);
    test_drive.set(order::CONTROL, INCREMENTAL);
    test_drive.write(order::POSITION, &[0xFFFF, 0xFFFF - 99]);
    test_drive.wait(1.0);
    assert_eq!(test_drive.read_long(monitor::POSITION), 900);
    assert_eq!(test_drive.read(order::CONTROL, 1), [0], "the flags hold for one move");
    // A target beyond the stroke of 50 mm moves it to 0.2 mm before the end.
    test_drive.write(order::POSITION, &[0, 6000]);
    test_drive.wait(3.0);
    assert_eq!(test_drive.read_long(monitor::POSITION), 4980);
    let too_far = Request::WriteRegisters { address: order::POSITION, values: vec![0x0F, 0x4240] };
    test_drive.refused(&too_far, Exception::Value);
    let elsewhere = Request::WriteRegister { address: 0x9000, value: 0 };
    test_drive.refused(&elsewhere, Exception::Address);
}

#[test]
fn without_home_a_move_is_an_alarm_and_the_reset_acts_when_it_is_released() {
    let mut test_drive = TestDrive::new(DriveMake::IaiRc);
    test_drive.write(order::POSITION, &[0, 100]);
    assert_eq!(test_drive.read(monitor::ALARM, 1), [0], "it is ignored without servo");
    test_drive.coil(coil::SERVO_ON, true);
    assert_eq!(test_drive.read(monitor::SYSTEM_STATUS, 2)[1], 1, "the terminals command");
    test_drive.coil(coil::MODBUS_COMMANDS, true);
    test_drive.coil(coil::SERVO_ON, true);
    test_drive.write(order::POSITION, &[0, 100]);
    assert_eq!(test_drive.read(monitor::ALARM, 1), [alarm::NO_HOME]);
    assert_eq!(test_drive.read(monitor::STATUS_1, 1)[0] & status::SERVO, 0);
    test_drive.coil(coil::ALARM_RESET, true);
    assert_eq!(test_drive.read(monitor::ALARM, 1), [alarm::NO_HOME]);
    test_drive.coil(coil::ALARM_RESET, false);
    assert_eq!(test_drive.read(monitor::ALARM, 1), [0]);
}

#[test]
fn a_pause_holds_the_move_and_a_stop_ends_it() {
    let mut test_drive = ready();
    test_drive.write(order::POSITION, &[0, 4000, 0, 10, 0, 2000, 30]);
    test_drive.wait(0.5);
    test_drive.coil(coil::PAUSE, true);
    test_drive.wait(1.0);
    let held = test_drive.read_long(monitor::POSITION);
    assert!((900..1200).contains(&held), "{held}");
    test_drive.coil(coil::PAUSE, false);
    test_drive.wait(5.0);
    assert_eq!(test_drive.read_long(monitor::POSITION), 4000);
    test_drive.write(order::POSITION, &[0, 0]);
    test_drive.wait(0.5);
    test_drive.coil(coil::STOP, true);
    test_drive.wait(5.0);
    let stopped = test_drive.read_long(monitor::POSITION);
    assert!((2500..3200).contains(&stopped), "{stopped}");
}

#[test]
fn a_homing_that_is_paused_is_done_when_it_has_gone_on() {
    for is_given_up in [false, true] {
        let mut test_drive = TestDrive::new(DriveMake::IaiRc);
        for coil in [coil::MODBUS_COMMANDS, coil::SERVO_ON, coil::HOME] {
            test_drive.coil(coil, true);
        }
        test_drive.wait(0.5);
        test_drive.coil(coil::PAUSE, true);
        test_drive.wait(5.0);
        let words = test_drive.read(monitor::FIRST, 10);
        assert_eq!(words[5] & status::HOMED, 0);
        assert_eq!(words[7] & status::HOMING, status::HOMING);
        if is_given_up {
            // Under a pause, the reset of an alarm cancels the rest of the way.
            test_drive.coil(coil::ALARM_RESET, true);
            test_drive.coil(coil::ALARM_RESET, false);
        }
        test_drive.coil(coil::PAUSE, false);
        test_drive.wait(5.0);
        let words = test_drive.read(monitor::FIRST, 10);
        assert_eq!(words[5] & status::HOMED != 0, !is_given_up);
        assert_eq!(words[7] & status::HOMING, 0);
        assert_eq!(words[1] == 0, !is_given_up);
    }
}

#[test]
fn the_status_can_be_read_as_bits_too() {
    let mut test_drive = ready();
    let bits = |test_drive: &mut TestDrive, address, count| match test_drive
        .ask(&Request::ReadDiscreteInputs(Block { address, count }))
    {
        Some(Ok(Reply::Bits(bits))) => bits,
        other => panic!("{other:?}"),
    };
    let register = test_drive.read(monitor::STATUS_1, 1)[0];
    let as_bits = bits(&mut test_drive, 0x0100, 16);
    let again = as_bits.iter().fold(0, |word, bit| word << 1 | u16::from(*bit));
    assert_eq!(again, register);
    test_drive
        .refused(&Request::ReadDiscreteInputs(Block { address: 0, count: 1 }), Exception::Address);
    let coils = Request::ReadCoils(Block { address: coil::SERVO_ON, count: 1 });
    assert_eq!(test_drive.ask(&coils), Some(Ok(Reply::Bits(vec![true]))));
}
