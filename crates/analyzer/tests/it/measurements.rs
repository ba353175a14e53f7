//! Sweeps, in health and under every fault of the line.

use std::{collections::BTreeMap, time::Duration};

use rig_analyzer::{Analyzer, AnalyzerError, TransportSettings};
use rig_files::instrument::HIOKI_IM3536;
use rig_link::{Clock, Port, StopSignal};
use rig_model::{
    DriveLevel, LineSettings, Parity, PointResult, Reading, ReadingFlag, StopBits, SweepPoint,
    Terminator, with_causes,
};
use tokio::io::{AsyncReadExt, AsyncWriteExt};

use crate::{
    im3536::{Im3536, impedance},
    peer::{FAULTS, Fault, serve, serve_ending_in},
};

pub(crate) fn analyzer_on(
    instrument: &Im3536,
    faults: impl IntoIterator<Item = (usize, Fault)>,
) -> Analyzer {
    let (host, device) = tokio::io::duplex(4096);
    tokio::spawn(serve(device, instrument.clone(), faults.into_iter().collect::<BTreeMap<_, _>>()));
    let line = LineSettings { baud: 57_600, parity: Parity::None, stop_bits: StopBits::One };
    Analyzer::open(Port::new("line 2", host, Some(line), Clock::start()), &HIOKI_IM3536)
}

fn points(frequencies_hz: &[f64]) -> Vec<SweepPoint> {
    points_of(20, frequencies_hz)
}

fn points_of(cycles: u32, frequencies_hz: &[f64]) -> Vec<SweepPoint> {
    let point = |&frequency_hz: &f64| SweepPoint { frequency_hz, settle_s: 0.05, cycles };
    frequencies_hz.iter().map(point).collect()
}

const LEVEL: DriveLevel = DriveLevel { volt: 5.0 };

pub(crate) async fn sweep(
    analyzer: &mut Analyzer,
    frequencies_hz: &[f64],
) -> Result<Vec<Reading>, AnalyzerError> {
    analyzer.identify().await?;
    analyzer.configure(LEVEL).await?;
    analyzer.measure(&points(frequencies_hz), &StopSignal::new()).await
}

#[track_caller]
pub(crate) fn assert_true_at(reading: &Reading, frequency_hz: f64) {
    let (resistance, reactance) = impedance(frequency_hz);
    assert_eq!(reading.frequency_hz, frequency_hz);
    let PointResult::Value(found) = reading.measured else { panic!("{reading:?}") };
    assert!((found.resistance_ohm / resistance - 1.0).abs() < 1e-6, "{reading:?}");
    assert!((found.reactance_ohm / reactance - 1.0).abs() < 1e-6, "{reading:?}");
}

const SWEEP_HZ: [f64; 4] = [190.0, 200.25, 200.25, 210.5];

#[tokio::test(start_paused = true)]
async fn a_sweep_is_measured_point_by_point_in_one_message_each() {
    let instrument = Im3536::new();
    let mut analyzer = analyzer_on(&instrument, []);
    let readings = sweep(&mut analyzer, &SWEEP_HZ).await.unwrap();
    assert_eq!(readings.len(), 4);
    for (reading, frequency_hz) in readings.iter().zip(SWEEP_HZ) {
        assert_true_at(reading, frequency_hz);
        assert_eq!(reading.integration_s, 20.0 / frequency_hz);
    }
    assert!(readings.is_sorted_by_key(|reading| reading.started));
    // The frequency stayed, so it has settled since the reading before.
    assert!((readings[1].settle_s - 0.05).abs() < 1e-9);
    assert_eq!(readings[2].started, readings[1].started);
    assert!(readings[2].settle_s > 0.05 + 20.0 / 200.25);
    let seen = instrument.seen();
    let tail: Vec<&str> = seen[seen.len() - 3..].iter().map(String::as_str).collect();
    assert_eq!(
        tail,
        [
            ":FREQuency 200.25;*TRG;:MEASure?;:FREQuency?;*ESR?",
            "*TRG;:MEASure?;:FREQuency?;*ESR?",
            ":FREQuency 210.5;*TRG;:MEASure?;:FREQuency?;*ESR?",
        ]
    );
}

#[tokio::test(start_paused = true)]
async fn an_instrument_that_takes_one_question_at_a_time_is_asked_so() {
    let instrument = Im3536::that_refuses_chains();
    let mut analyzer = analyzer_on(&instrument, []);
    let readings = sweep(&mut analyzer, &SWEEP_HZ).await.unwrap();
    for (reading, frequency_hz) in readings.iter().zip(SWEEP_HZ) {
        assert_true_at(reading, frequency_hz);
    }
    let seen = instrument.seen();
    assert_eq!(seen[seen.len() - 3..], [":FREQuency 210.5;*TRG;:MEASure?", ":FREQuency?", "*ESR?"]);
}

#[tokio::test(start_paused = true)]
async fn what_the_instrument_cannot_do_is_refused_before_it_is_sent() {
    let instrument = Im3536::new();
    let mut analyzer = analyzer_on(&instrument, []);
    analyzer.identify().await.unwrap();
    let n_sent = instrument.seen().len();
    let error = analyzer.configure(DriveLevel { volt: 5.1 }).await.unwrap_err();
    assert_eq!(error.to_string(), "hioki-im3536: level in V 5.1 is outside [0.01, 5]");
    assert_eq!(instrument.seen().len(), n_sent);

    let stop = StopSignal::new();
    let error = analyzer.measure(&points(&[200.0]), &stop).await.unwrap_err();
    assert!(matches!(error, AnalyzerError::NotConfigured { .. }), "{error}");
    analyzer.configure(LEVEL).await.unwrap();
    assert_eq!(instrument.level_v(), 5.0);
    let n_sent = instrument.seen().len();
    let error = analyzer.measure(&points(&[200.0, 3.9]), &stop).await.unwrap_err();
    assert_eq!(error.to_string(), "hioki-im3536: frequency in Hz 3.9 is outside [4, 8000000]");
    assert_eq!(instrument.seen().len(), n_sent);
    stop.raise();
    let error = analyzer.measure(&points(&[200.0]), &stop).await.unwrap_err();
    assert!(matches!(error, AnalyzerError::Stopped { done: 0, points: 1 }), "{error}");
}

#[tokio::test(start_paused = true)]
async fn a_point_that_stays_flagged_is_given_up_after_three_tries() {
    let instrument = Im3536::new();
    let mut analyzer = analyzer_on(&instrument, []);
    sweep(&mut analyzer, &[200.0]).await.unwrap();
    for (status, flag) in [(1, ReadingFlag::LowSignal), (2, ReadingFlag::Overload)] {
        instrument.set_status(status);
        let both = points(&[201.0, 202.0]);
        let readings = analyzer.measure(&both, &StopSignal::new()).await.unwrap();
        assert_eq!(readings.len(), 3, "{readings:?}");
        for reading in readings {
            assert_eq!((reading.frequency_hz, reading.flag()), (201.0, Some(flag)));
            assert_eq!(reading.impedance().is_none(), flag == ReadingFlag::Overload);
        }
    }
}

#[tokio::test(start_paused = true)]
async fn what_the_instrument_cannot_wait_or_average_at_once_is_still_done() {
    let instrument = Im3536::new();
    let mut analyzer = analyzer_on(&instrument, []);
    sweep(&mut analyzer, &[200.0]).await.unwrap();
    let stop = StopSignal::new();
    let long = SweepPoint { frequency_hz: 250.0, settle_s: 15.0, cycles: 600 };
    let readings = analyzer.measure(&[long], &stop).await.unwrap();
    assert_true_at(&readings[0], 250.0);
    assert!((15.0..15.1).contains(&readings[0].settle_s), "{}", readings[0].settle_s);
    assert!((readings[0].integration_s - 2.4).abs() < 1e-9);
    let seen = instrument.seen();
    let tail: Vec<&str> = seen[seen.len() - 4..].iter().map(String::as_str).collect();
    let again = "*TRG;:MEASure?;:FREQuency?;*ESR?";
    assert_eq!(tail[0], ":FREQuency 250;:AVERaging 200;:TRIGger:DELay 9.9999;*ESR?");
    assert_eq!(tail[1], again);
    assert_eq!(tail[2], format!(":TRIGger:DELay 0;{again}"));
    assert_eq!(tail[3], again);

    // A stop is not kept waiting.
    let raise = stop.clone();
    tokio::spawn(async move {
        tokio::time::advance(std::time::Duration::from_secs(2)).await;
        raise.raise();
    });
    let started = tokio::time::Instant::now();
    let longer = SweepPoint { frequency_hz: 260.0, settle_s: 60.0, cycles: 1 };
    let error = analyzer.measure(&[longer], &stop).await.unwrap_err();
    assert!(matches!(error, AnalyzerError::Stopped { done: 0, points: 1 }), "{error}");
    assert!(started.elapsed().as_secs_f64() < 2.1);
}

#[tokio::test(start_paused = true)]
async fn another_instrument_is_recognised() {
    let instrument = Im3536::new();
    let mut analyzer = analyzer_on(&instrument, []);
    analyzer.identify().await.unwrap();
    instrument.become_another("HIOKI,IM3536,190599999,V1.10");
    let error = analyzer.identify().await.unwrap_err();
    assert!(matches!(error, AnalyzerError::Swapped { .. }), "{error}");
    instrument.become_another("RIGOL TECHNOLOGIES,DS1054Z,1,2");
    let error = analyzer.identify().await.unwrap_err();
    assert_eq!(
        error.to_string(),
        "line 2: expected HIOKI IM3536, IM3533 or IM3570, found RIGOL TECHNOLOGIES DS1054Z, \
         serial number 1, firmware 2"
    );
}

#[tokio::test(start_paused = true)]
async fn a_wrong_bit_in_an_identity_is_no_other_instrument() {
    for n in 0..8 {
        let instrument = Im3536::new();
        let mut analyzer = analyzer_on(&instrument, [(n, Fault::AnswerWrong)]);
        for _ in 0..3 {
            let identity = analyzer.identify().await.unwrap();
            assert_eq!(identity.firmware.as_deref(), Some("V1.10"), "message {n}");
        }
    }
}

#[tokio::test(start_paused = true)]
async fn what_is_wrong_with_a_line_is_said_in_words() {
    let all = |fault| (0..100).map(move |n| (n, fault));
    let asked = "asked `:HEADer OFF;*CLS;*IDN?`";
    let late = "line 2: no complete answer within 1048 ms";
    let rows = [
        (Fault::AnswerLost, format!("{asked}: {late}, nothing arrived")),
        (
            Fault::AnswerCut,
            format!(
                "{asked}: {late}, 27 bytes arrived, the last after 0 ms: \
                     `HIOKI,IM3536,190512345,V1.1`"
            ),
        ),
        (
            Fault::AnswerEndsInCr,
            format!(
                "{asked} (the answer ended in CR where LF was expected): {late}, 29 bytes arrived, \
                 the last after 0 ms: `HIOKI,IM3536,190512345,V1.10\\r`"
            ),
        ),
        (
            // Of the first answer, which still comes at the third attempt.
            Fault::AnswerDrips { ms: 400 },
            format!("{asked}: {late}, 3 bytes arrived, the last after 902 ms: `353`"),
        ),
        (
            Fault::AnswerGarbled,
            "line 2: asked `:HEADer OFF;*CLS;*IDN?`, found \
             `\\xc3IOKI,IM3536,190512345,V1.10\\r\\n`: \
             byte 0xC3 at offset 0 of an answer is not ASCII"
                .to_owned(),
        ),
        (Fault::AnswerTwice, "line 2: 30 unexpected bytes arrived before a query".to_owned()),
    ];
    for (fault, expected) in rows {
        let instrument = Im3536::new();
        let mut analyzer = analyzer_on(&instrument, all(fault));
        let error = analyzer.identify().await.unwrap_err();
        assert_eq!(with_causes(&error), expected, "{fault:?}");
    }
}

#[tokio::test(start_paused = true)]
async fn an_instrument_that_ends_its_lines_otherwise_or_is_slow_is_spoken_to_as_it_wants() {
    let slow = Duration::from_secs(3);
    for (terminator, ending) in
        [(Terminator::Cr, b"\r" as &[u8]), (Terminator::CrLf, b"\r\n"), (Terminator::Lf, b"\n")]
    {
        let instrument = Im3536::new();
        let (host, device) = tokio::io::duplex(4096);
        let faults = (0..100).map(|n| (n, Fault::AnswerLate { ms: 1700 })).collect();
        let answering = instrument.clone();
        tokio::spawn(async move { serve_ending_in(ending, device, answering, faults).await });
        let port = Port::new("line 2", host, None, Clock::start());
        let settings = TransportSettings { terminator: Some(terminator), reply_within: slow };
        let mut analyzer = Analyzer::open_with(port, &HIOKI_IM3536, settings);
        let readings = sweep(&mut analyzer, &[200.0]).await.unwrap();
        assert_eq!(readings.len(), 1, "{terminator:?}");
    }
    // Where the answers end in a line feed and a carriage return is expected, that is said.
    let (host, device) = tokio::io::duplex(4096);
    tokio::spawn(async move {
        let (mut device, mut message) = (device, Vec::new());
        while device.read_buf(&mut message).await.unwrap_or(0) > 0 {
            _ = device.write_all(b"HIOKI,IM3536,1,V1\n").await;
        }
    });
    let port = Port::new("line 2", host, None, Clock::start());
    let settings =
        TransportSettings { terminator: Some(Terminator::Cr), ..TransportSettings::default() };
    let error = Analyzer::open_with(port, &HIOKI_IM3536, settings).identify().await.unwrap_err();
    let text = with_causes(&error);
    assert!(text.contains("(the answer ended in LF where CR was expected)"), "{text}");
}

#[tokio::test(start_paused = true)]
async fn a_measurement_that_nobody_waited_for_is_not_taken_for_the_next() {
    let instrument = Im3536::new();
    let mut analyzer = analyzer_on(&instrument, []);
    sweep(&mut analyzer, &[200.0]).await.unwrap();
    // Dropped at any moment of its exchange.
    for ms in 0..200 {
        let stop = StopSignal::new();
        let long = SweepPoint { frequency_hz: 205.0, settle_s: 0.05, cycles: 20 };
        let abandoned = analyzer.measure(std::slice::from_ref(&long), &stop);
        _ = tokio::time::timeout(std::time::Duration::from_millis(ms), abandoned).await;
        let readings = analyzer.measure(&points_of(1, &[205.0]), &stop).await.unwrap();
        assert_eq!(readings[0].integration_s, 1.0 / 205.0, "dropped after {ms} ms");
        assert_true_at(&readings[0], 205.0);
    }
}

#[tokio::test(start_paused = true)]
async fn a_refusal_is_told_from_a_lost_answer_although_both_are_silent() {
    let instrument = Im3536::new();
    let mut analyzer = analyzer_on(&instrument, []);
    sweep(&mut analyzer, &[200.0]).await.unwrap();
    instrument.refuse_averages();
    let error = analyzer.measure(&points_of(30, &[201.0]), &StopSignal::new()).await.unwrap_err();
    assert_eq!(
        error.to_string(),
        // A point that is begun again settles for two seconds.
        "line 2: refused `:FREQuency 201;:AVERaging 30;:TRIGger:DELay 2;*TRG;\
         :MEASure?;:FREQuency?;*ESR?`: execution error (event status 16)"
    );
}

/// Any fault in any message: a returned reading is right.
#[tokio::test(start_paused = true)]
async fn no_single_fault_makes_a_reading_lie() {
    for refuses_chains in [false, true] {
        for fault in FAULTS {
            for message in 0..20 {
                let instrument =
                    if refuses_chains { Im3536::that_refuses_chains() } else { Im3536::new() };
                let mut analyzer = analyzer_on(&instrument, [(message, fault)]);
                let readings = sweep(&mut analyzer, &SWEEP_HZ).await;
                let readings = readings.unwrap_or_else(|error| {
                    panic!("{fault:?} at message {message}, {refuses_chains}: {error:?}")
                });
                assert_eq!(readings.len(), SWEEP_HZ.len());
                for (reading, frequency_hz) in readings.iter().zip(SWEEP_HZ) {
                    assert_true_at(reading, frequency_hz);
                }
            }
        }
    }
}
