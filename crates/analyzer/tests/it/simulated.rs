//! The dialects against the simulated instruments, which share no line with them.

use rig_analyzer::{Analyzer, AnalyzerError, Dialect};
use rig_files::instrument::{KEYSIGHT_E4980A, KEYSIGHT_E4990A, TONGHUI_TH283X};
use rig_link::{Clock, Flow, Port, StopSignal};
use rig_model::{AnalyzerMake, DriveLevel, Reading, ReadingFlag, SweepPoint};
use rig_sim::{
    LineTransport, SimRig, Wiring, control,
    scene::matched,
    world::{Nuisances, Scene},
};

/// A bench without nuisances, with this analyzer.
fn bench(model: AnalyzerMake) -> SimRig {
    let transport = LineTransport::Serial { baud: 115_200 };
    let wiring = Wiring { analyzer: model, ..Wiring::paper(transport) };
    let scene = Scene { nuisances: Nuisances::NONE, ..matched() };
    SimRig::start(scene, &wiring, 1).unwrap()
}

async fn analyzer_on(rig: &mut SimRig, dialect: &'static Dialect) -> Analyzer {
    let port = Port::new("analyzer", rig.analyzer_port(), None, Clock::start());
    let mut analyzer = Analyzer::open(port, dialect);
    let identity = analyzer.identify().await.unwrap();
    assert!(identity.serial.is_some(), "{identity}");
    analyzer
}

/// Three makes, each with a level that it gives, V.
fn makes() -> [(AnalyzerMake, &'static Dialect, f64); 3] {
    let makes = [
        (AnalyzerMake::HiokiIm3536, 5.0),
        (AnalyzerMake::KeysightE4980a, 5.0),
        (AnalyzerMake::KeysightE4990a, 1.0),
    ];
    makes.map(|(make, volt)| (make, Dialect::of(make), volt))
}

fn point(frequency_hz: f64, cycles: u32) -> SweepPoint {
    SweepPoint { frequency_hz, settle_s: 3.0, cycles }
}

#[tokio::test(start_paused = true)]
async fn three_makes_measure_the_same_sensor() {
    // Evenly spaced, then not, and more cycles than one trigger of any make averages.
    let points =
        [point(130.0, 2), point(135.0, 2), point(140.0, 2), point(150.0, 2), point(141.3, 990)];
    let mut all: Vec<Vec<Reading>> = Vec::new();
    for (model, dialect, volt) in makes() {
        let mut rig = bench(model);
        let mut analyzer = analyzer_on(&mut rig, dialect).await;
        analyzer.configure(DriveLevel { volt }).await.unwrap();
        let readings = analyzer.measure(&points, &StopSignal::new()).await.unwrap();
        assert!(readings.is_sorted_by_key(|reading| reading.started), "{}", dialect.name);
        for (reading, point) in readings.iter().zip(&points) {
            let context = (&dialect.name, point.frequency_hz);
            assert_eq!(reading.frequency_hz, point.frequency_hz, "{context:?}");
            assert_eq!(reading.flag(), None, "{context:?}");
            assert!(point.settle_s <= reading.settle_s, "{context:?}: {}", reading.settle_s);
            let asked_s = f64::from(point.cycles) / point.frequency_hz;
            assert!(asked_s <= reading.integration_s, "{context:?}: {}", reading.integration_s);
        }
        all.push(readings);
    }
    for other in &all[1..] {
        for (one, two) in all[0].iter().zip(other) {
            let (one, two) = (one.impedance().unwrap(), two.impedance().unwrap());
            let off = (one.resistance_ohm - two.resistance_ohm)
                .hypot(one.reactance_ohm - two.reactance_ohm);
            assert!(off < 2e-5 * one.magnitude_ohm(), "{one:?} {two:?}");
        }
    }
}

#[tokio::test(start_paused = true)]
async fn an_overload_is_measured_again_and_one_that_stays_is_given_up() {
    let points = [130.0, 135.0, 140.0, 141.3].map(|hz| point(hz, 10));
    for (model, dialect, volt) in makes() {
        let mut rig = bench(model);
        let mut analyzer = analyzer_on(&mut rig, dialect).await;
        analyzer.configure(DriveLevel { volt }).await.unwrap();
        let overload = |times: u32| {
            let fault = || {
                rig.handle().with(|now, rig| {
                    control::execute(now, rig, "fault analyzer overload").unwrap();
                });
            };
            (0..times).for_each(|_| fault());
        };
        overload(1);
        let readings = analyzer.measure(&points, &StopSignal::new()).await.unwrap();
        let flags: Vec<_> = readings.iter().map(Reading::flag).collect();
        let once = [Some(ReadingFlag::Overload), None, None, None, None];
        assert_eq!(flags, once, "{}", dialect.name);
        assert!(readings.is_sorted_by_key(|reading| reading.started), "{}", dialect.name);
        let found: Vec<f64> = readings[1..].iter().map(|reading| reading.frequency_hz).collect();
        assert_eq!(found, [130.0, 135.0, 140.0, 141.3], "{}", dialect.name);

        overload(100);
        let readings = analyzer.measure(&points, &StopSignal::new()).await.unwrap();
        let flags: Vec<_> = readings.iter().map(Reading::flag).collect();
        assert_eq!(flags, [Some(ReadingFlag::Overload); 3], "{}", dialect.name);
    }
}

/// The analyzer was set up again, with its own frequency in between, and the sensor rings.
#[tokio::test(start_paused = true)]
async fn a_reading_after_a_cut_reply_is_one_of_a_settled_sensor() {
    let brief = SweepPoint { settle_s: 0.0, ..point(140.2, 2) };
    for (model, dialect, volt) in makes() {
        for nth in 0..6 {
            let mut rig = bench(model);
            let mut analyzer = analyzer_on(&mut rig, dialect).await;
            analyzer.configure(DriveLevel { volt }).await.unwrap();
            let stop = StopSignal::new();
            let settled = analyzer.measure(&[point(140.2, 2)], &stop).await.unwrap();
            rig.handle().with(|now, rig| {
                let fault = format!("fault analyzer truncate nth={}", nth + 1);
                control::execute(now, rig, &fault).unwrap();
            });
            let after = analyzer.measure(&[brief, brief], &stop).await.unwrap();
            for after in after {
                let [one, two] = [settled[0], after].map(|reading| reading.impedance().unwrap());
                let off = (one.resistance_ohm - two.resistance_ohm)
                    .hypot(one.reactance_ohm - two.reactance_ohm);
                assert!(
                    off < 1e-3 * one.magnitude_ohm(),
                    "{} {nth}: {one:?} {two:?}",
                    dialect.name
                );
            }
        }
    }
}

/// The instrument says when a trace is over, and that answer may be late; its points were not.
#[tokio::test(start_paused = true)]
async fn the_times_of_a_trace_do_not_depend_on_a_late_answer() {
    let mut rig = bench(AnalyzerMake::KeysightE4990a);
    let mut analyzer = analyzer_on(&mut rig, &KEYSIGHT_E4990A).await;
    analyzer.configure(DriveLevel { volt: 1.0 }).await.unwrap();
    let points = [140.0; 5].map(|hz| SweepPoint { settle_s: 0.0, ..point(hz, 2) });
    let stop = StopSignal::new();
    let spans_s = async |analyzer: &mut Analyzer| {
        let readings = analyzer.measure(&points, &stop).await.unwrap();
        readings[4].started.since(readings[0].started).as_secs_f64()
    };
    let in_time_s = spans_s(&mut analyzer).await;
    rig.handle().with(|now, rig| {
        control::execute(now, rig, "fault analyzer delay ms=300 nth=2").unwrap();
    });
    let late_s = spans_s(&mut analyzer).await;
    assert!((late_s - in_time_s).abs() < 1e-3, "{in_time_s} s, {late_s} s");
    assert!((in_time_s - 8.0 / 140.0).abs() < 0.01, "{in_time_s} s");
}

/// A trace has two points, and waits before each: a single point does not wait twice as long as it was asked to.
#[tokio::test(start_paused = true)]
async fn the_first_point_of_a_trace_is_a_part_of_the_wait_of_a_single_one() {
    let mut rig = bench(AnalyzerMake::KeysightE4990a);
    let mut analyzer = analyzer_on(&mut rig, &KEYSIGHT_E4990A).await;
    analyzer.configure(DriveLevel { volt: 1.0 }).await.unwrap();
    let point = SweepPoint { settle_s: 0.5, ..point(140.0, 2) };
    let began = tokio::time::Instant::now();
    let reading = analyzer.measure(&[point], &StopSignal::new()).await.unwrap()[0];
    let took_s = began.elapsed().as_secs_f64();
    let whole_s = 0.5 + 2.0 / 140.0;
    assert!((whole_s..whole_s + 0.1).contains(&took_s), "{took_s} s");
    assert!((reading.settle_s - 0.5).abs() < 0.01, "{reading:?}");
    assert!((reading.integration_s - 2.0 / 140.0).abs() < 1e-9, "{reading:?}");
}

#[tokio::test(start_paused = true)]
async fn a_tonghui_is_left_alone_while_it_measures() {
    let mut rig = bench(AnalyzerMake::TonghuiTh283x);
    let mut analyzer = analyzer_on(&mut rig, &TONGHUI_TH283X).await;
    analyzer.configure(DriveLevel { volt: 1.0 }).await.unwrap();
    analyzer.measure(&[point(140.0, 2)], &StopSignal::new()).await.unwrap();
    let frames = analyzer.transcript().frames();
    let sent = frames.iter().filter(|frame| frame.flow == Flow::Sent);
    let sent: Vec<u8> = sent.flat_map(|frame| frame.bytes.clone()).collect();
    let fetches = String::from_utf8(sent).unwrap().matches(":FETC?").count();
    // With the trigger, when the time is over, and where its averages take longer than the manual says.
    assert!((2..=4).contains(&fetches), "asked {fetches} times in 3 s");
}

#[tokio::test(start_paused = true)]
async fn a_level_is_what_the_model_and_its_options_can_give() {
    let rows = [
        (20.1, "keysight-e4980a: level in V 20.1 is outside [0.005, 20]"),
        (1.01, "keysight-e4990a: level in V 1.01 is outside [0.005, 1]"),
    ];
    for ((model, dialect, _), (volt, message)) in makes()[1..].iter().zip(rows) {
        let mut rig = bench(*model);
        let mut analyzer = analyzer_on(&mut rig, dialect).await;
        let error = analyzer.configure(DriveLevel { volt }).await.unwrap_err();
        assert_eq!(error.to_string(), message);
    }
}

#[tokio::test(start_paused = true)]
async fn a_level_that_stands_is_not_set_again() {
    for (model, dialect, volt) in makes() {
        let mut rig = bench(model);
        let mut analyzer = analyzer_on(&mut rig, dialect).await;
        analyzer.configure(DriveLevel { volt }).await.unwrap();
        let sent = |analyzer: &Analyzer| analyzer.transcript().frames().len();
        let before = sent(&analyzer);
        analyzer.configure(DriveLevel { volt }).await.unwrap();
        assert_eq!(sent(&analyzer), before, "{}", dialect.name);
        analyzer.configure(DriveLevel { volt: 0.5 }).await.unwrap();
        assert!(before < sent(&analyzer));
    }
}

#[tokio::test(start_paused = true)]
async fn the_wrong_dialect_is_found_out_by_the_identity() {
    let mut rig = bench(AnalyzerMake::KeysightE4990a);
    let port = Port::new("analyzer", rig.analyzer_port(), None, Clock::start());
    let error = Analyzer::open(port, &KEYSIGHT_E4980A).identify().await.unwrap_err();
    assert!(matches!(error, AnalyzerError::WrongInstrument { .. }), "{error}");
}

#[tokio::test(start_paused = true)]
async fn every_frequency_of_a_range_is_set_as_the_driver_expects_it() {
    for model in AnalyzerMake::ALL {
        let dialect = Dialect::of(model);
        let mut rig = bench(model);
        let mut analyzer = analyzer_on(&mut rig, dialect).await;
        analyzer.configure(DriveLevel { volt: 1.0 }).await.unwrap();
        let (min_hz, max_hz) = dialect.frequency_hz;
        let odd = (0..40).map(|n| min_hz * (max_hz / min_hz).powf(f64::from(n) / 40.3));
        for frequency_hz in odd.chain([1487.29, 999.996, min_hz, max_hz]) {
            let point = SweepPoint { frequency_hz, settle_s: 0.0, cycles: 1 };
            let measured = analyzer.measure(&[point], &StopSignal::new()).await;
            let found_hz =
                measured.unwrap_or_else(|e| panic!("{}: {e}", dialect.name))[0].frequency_hz;
            let off = (found_hz / frequency_hz - 1.0).abs();
            assert!(off < 0.01, "{}: {frequency_hz} Hz became {found_hz} Hz", dialect.name);
        }
    }
}

#[tokio::test(start_paused = true)]
async fn corrections_are_measured_switched_on_and_read_back() {
    for make in [AnalyzerMake::KeysightE4980a, AnalyzerMake::Hp4284a] {
        let dialect = Dialect::of(make);
        let compensation = dialect.compensation.as_ref().unwrap();
        let mut rig = bench(make);
        let mut analyzer = analyzer_on(&mut rig, dialect).await;
        analyzer.configure(DriveLevel { volt: 1.0 }).await.unwrap();
        let cable = compensation.cable.as_ref().unwrap();
        for &length_m in &cable.lengths_m {
            analyzer.set_cable(cable, length_m).await.unwrap();
        }
        let refused = analyzer.set_cable(cable, 7.0).await.unwrap_err();
        assert!(matches!(refused, AnalyzerError::Refused { .. }), "{refused}");
        for correction in [&compensation.open, &compensation.short] {
            assert!(!analyzer.has_correction(correction).await.unwrap(), "{make}");
            analyzer.correct(correction).await.unwrap();
            assert!(analyzer.has_correction(correction).await.unwrap(), "{make}");
        }
        // It measures as before.
        let readings = analyzer.measure(&[point(140.0, 2)], &StopSignal::new()).await.unwrap();
        assert_eq!(readings[0].flag(), None);
    }
    assert_eq!(Dialect::of(AnalyzerMake::HiokiIm3536).compensation, None);
}
