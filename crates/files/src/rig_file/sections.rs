//! The sections of the file, and the checks between them.

use std::path::PathBuf;

use rig_model::{
    AnalyzerMake, AnalyzerRange, Deg, DriveMake, Geometry, Mm, MotionLimits, Parity, Position,
    ReadingStream, RigLimits, Scale, Terminator,
};

use super::{
    AnalyzerFile, Connection, Pace, PortFile, RigFile, SimulatedPerson, Simulation,
    axis::{self, AxisRead},
    fault::RigFileFault,
    port::{Role, port},
    sensor,
};
use crate::{
    instrument::{Dialect, Named, RegisterMap},
    samples::samples,
    settings::{Presence, Setting, Table},
};

/// Reads a rig file from its root.
pub(super) fn rig(table: &mut Table<'_>) -> RigFile {
    let name = table.text("name").required().value;
    let connection = connection(table);
    let analyzer = table.section("analyzer", analyzer).required();
    let linear = table.section("linear", |table| axis::axis::<Mm>(table, &axis::LINEAR));
    let linear = linear.required().value;
    let rotary = table.section("rotary", |table| axis::axis::<Deg>(table, &axis::ROTARY));
    let rotary = rotary.required().value;
    let parity = line_parity(linear.instrument.as_ref(), rotary.instrument.as_ref());
    let port = |table: &mut Table<'_>| port(table, Role::Drives, parity.clone());
    let bus = table.section("bus", |table| table.section("port", port).required().value);
    let bus = bus.required();
    let geometry = table.section("geometry", geometry).required().value;
    let limits = table.section("limits", limits).required().value;
    let recovery = table.section("recovery", recovery).or(PATIENCE_S).value;
    let sensor = sensor::sensor(table, geometry.is_sound.then_some(&geometry.geometry));
    let samples = samples(table, Presence::Optional, |_, known| known);

    if let (PortFile::Serial { path, .. }, PortFile::Serial { path: other, .. }) =
        (&analyzer.value.file.port, &bus.value)
        && path == other
        && !path.is_empty()
    {
        table.refuse(&bus, &RigFileFault::SharedPort { port: path.clone() });
    }
    if linear.unit_id.sound().is_some_and(|unit_id| rotary.unit_id.sound() == Some(unit_id)) {
        let unit_id = rotary.unit_id.value;
        table.refuse(&rotary.unit_id, &RigFileFault::SharedUnit { unit_id });
    }
    speeds(table, &limits, &linear, &rotary);
    heights(table, &geometry, &limits, &linear, &rotary);

    RigFile {
        name,
        connection,
        limits: RigLimits {
            linear: linear.axis,
            rotary: rotary.axis,
            geometry: geometry.geometry,
            motion: limits.limits(slowest(linear.instrument.as_ref(), &linear.file.scale)),
            analyzer: analyzer.value.range,
        },
        analyzer: analyzer.value.file,
        bus: bus.value,
        linear: linear.file,
        rotary: rotary.file,
        sensor,
        samples,
        recovery_patience_s: recovery,
    }
}

/// Patience on the way out of contact if the file has none, s: a drive starts within seconds, and a
/// person plugs a cable in again within a minute or two.
const PATIENCE_S: f64 = 120.0;

/// The patience on the way out of contact, s. A day is longer than any person is away from a bench whose
/// probe is in a sample.
fn recovery(table: &mut Table<'_>) -> f64 {
    table.number("patience_s").range(1.0..=86_400.0).or(PATIENCE_S).value
}

fn connection(table: &mut Table<'_>) -> Connection {
    let words = [("ports", false), ("simulated", true)];
    let is_simulated = table.choice("connection", words).required();
    // A real rig may keep the section: then one word changes it into its simulation.
    let simulation = table.section("simulation", simulation).optional();
    match (is_simulated.value, simulation) {
        (true, Some(simulation)) => Connection::Simulated(simulation.value),
        (true, None) => {
            table.refuse(&is_simulated, &RigFileFault::NothingToSimulate);
            Connection::Ports
        }
        (false, _) => Connection::Ports,
    }
}

fn simulation(table: &mut Table<'_>) -> Simulation {
    let pace = table.choice("pace", [("virtual", Pace::Virtual), ("real", Pace::Real)]);
    let pace = pace.or(Pace::Virtual).value;
    let person = [("answers", SimulatedPerson::Answers), ("waits", SimulatedPerson::Waits)];
    let person = table.choice("person", person).or(SimulatedPerson::Answers).value;
    let scene = table.text("scene").required();
    Simulation { scene_location: scene.location, scene: PathBuf::from(scene.value), pace, person }
}

struct AnalyzerRead {
    file: AnalyzerFile,
    range: AnalyzerRange,
}

fn analyzer(table: &mut Table<'_>) -> AnalyzerRead {
    let makes = AnalyzerMake::ALL.map(|make| (make.name(), make));
    let instrument = table.choice_or_file("dialect", makes).required();
    let port = table.section("port", |table| port(table, Role::Analyzer, Ok(Parity::None)));
    let port = port.required().value;
    let terminators = Terminator::ALL.map(|terminator| (terminator.name(), terminator));
    let terminator = table.choice("terminator", terminators).optional();
    let reply_timeout_s = table.number("reply_timeout_s").range(0.05..=60.0).or(1.0).value;
    let frequency_hz = table.number("frequency_hz").above(0.0).interval().required();
    let max_level_v = table.number("max_level_v").above(0.0).required();
    // The ranges of another instrument are compared when its file is read.
    if let Some(&Named::Shipped(make)) = instrument.sound() {
        let dialect = Dialect::of(make);
        let ((min, max), limit) = (dialect.frequency_hz, dialect.highest_level_v());
        if frequency_hz.sound().is_some_and(|&(lowest, highest)| lowest < min || max < highest) {
            let refusal = RigFileFault::BeyondDialect { make, min, max };
            table.refuse(&frequency_hz, &refusal);
        }
        if let Some(&found) = max_level_v.sound().filter(|&&level| level > limit) {
            let refusal = RigFileFault::LevelBeyondDialect { found, limit, make };
            table.refuse(&max_level_v, &refusal);
        }
    }
    let latency_s = table.number("latency_s").range(-0.1..=0.1).or(0.0).value;
    let latency_sigma_s = table.number("latency_sigma_s").range(0.0001..=0.1);
    let latency_sigma_s = latency_sigma_s.or(ReadingStream::LATENCY_SIGMA_S).value;
    let overhead_s = table.number("stream_overhead_s").range(0.0005..=10.0).optional();
    let of_make = match instrument.value {
        Named::Shipped(make) => make.stream_overhead_s(),
        Named::File { .. } => None,
    };
    let overhead_s = overhead_s.map(|overhead_s| overhead_s.value).or(of_make);
    let stream = ReadingStream { overhead_s, latency_s, latency_sigma_s };
    let (frequency_hz, max_level_v) = (frequency_hz.value, max_level_v.value);
    // Another instrument says it in its own file.
    let shortest_integration_s = match instrument.value {
        Named::Shipped(make) => {
            Dialect::of(make).shortest_integration_s(AnalyzerRange::RESONANCE_HZ)
        }
        Named::File { .. } => 0.0,
    };
    let min_level_v = match instrument.value {
        Named::Shipped(make) => Dialect::of(make).level_v.0,
        Named::File { .. } => 0.0,
    };
    let range =
        AnalyzerRange { frequency_hz, max_level_v, min_level_v, shortest_integration_s, stream };
    AnalyzerRead {
        file: AnalyzerFile {
            instrument: instrument.value,
            port,
            terminator: terminator.map(|terminator| terminator.value),
            reply_timeout_s,
        },
        range,
    }
}

/// The parity of a line whose drives have their factory settings.
fn line_parity(
    linear: Option<&Named<DriveMake>>,
    rotary: Option<&Named<DriveMake>>,
) -> Result<Parity, RigFileFault> {
    let parity = |make: DriveMake| RegisterMap::of(make).parity;
    match (linear, rotary) {
        (Some(Named::File { .. }), _) | (_, Some(Named::File { .. })) => {
            Err(RigFileFault::UnreadParity)
        }
        (Some(&Named::Shipped(linear)), Some(&Named::Shipped(rotary)))
            if parity(linear) != parity(rotary) =>
        {
            Err(RigFileFault::NoParity { linear, rotary })
        }
        (Some(&Named::Shipped(make)), _) | (None, Some(&Named::Shipped(make))) => Ok(parity(make)),
        (None, None) => Ok(Parity::None),
    }
}

struct GeometryRead {
    geometry: Geometry,
    surface_mm: Setting<f64>,
    pin_radius_mm: Option<Setting<f64>>,
    /// Whether none of its values is faulty.
    is_sound: bool,
}

fn geometry(table: &mut Table<'_>) -> GeometryRead {
    let surface_mm = table.number("surface_mm").required();
    let surface_above_pivot_mm = table.number("surface_above_pivot_mm").required();
    let probe_beside_pivot_mm = table.number("probe_beside_pivot_mm").or(0.0);
    // Real benches are within these ranges. Other numbers have another unit.
    let probe_radius_mm = table.number("probe_radius_mm").range(0.01..=50.0).required();
    let sample_half_width_mm = table.number("sample_half_width_mm").range(0.5..=500.0).required();
    let surface_tolerance_mm = table.number("surface_tolerance_mm").range(0.0..=50.0).required();
    let pin_radius_mm = table.number("pin_radius_mm").range(0.1..=50.0).optional();
    let all = [
        &surface_mm,
        &surface_above_pivot_mm,
        &probe_beside_pivot_mm,
        &probe_radius_mm,
        &sample_half_width_mm,
        &surface_tolerance_mm,
    ];
    GeometryRead {
        is_sound: all.iter().all(|setting| setting.sound().is_some())
            && pin_radius_mm.as_ref().is_none_or(|pin| pin.sound().is_some()),
        geometry: Geometry {
            surface: Position::new(surface_mm.value),
            surface_above_pivot_mm: surface_above_pivot_mm.value,
            probe_beside_pivot_mm: probe_beside_pivot_mm.value,
            probe_radius_mm: probe_radius_mm.value,
            sample_half_width_mm: sample_half_width_mm.value,
            surface_tolerance_mm: surface_tolerance_mm.value,
            pin_radius_mm: pin_radius_mm.as_ref().map(|pin| pin.value),
        },
        surface_mm,
        pin_radius_mm,
    }
}

struct LimitsRead {
    max_indentation_mm: Setting<f64>,
    travel_speed_mm_per_s: Setting<f64>,
    contact_speed_mm_per_s: Setting<f64>,
    rotary_speed_deg_per_s: Setting<f64>,
}

fn limits(table: &mut Table<'_>) -> LimitsRead {
    LimitsRead {
        // The ranges are those of the geometry and of the axes.
        max_indentation_mm: table.number("max_indentation_mm").range(0.005..=50.0).required(),
        travel_speed_mm_per_s: table.number("travel_speed_mm_per_s").range(0.1..=2000.0).required(),
        contact_speed_mm_per_s: table
            .number("contact_speed_mm_per_s")
            .range(0.005..=200.0)
            .required(),
        rotary_speed_deg_per_s: table
            .number("rotary_speed_deg_per_s")
            .range(0.1..=10_000.0)
            .required(),
    }
}

impl LimitsRead {
    fn limits(&self, slowest_mm_per_s: f64) -> MotionLimits {
        MotionLimits {
            max_indentation_mm: self.max_indentation_mm.value,
            travel_speed_mm_per_s: self.travel_speed_mm_per_s.value,
            contact_speed_mm_per_s: self.contact_speed_mm_per_s.value,
            rotary_speed_deg_per_s: self.rotary_speed_deg_per_s.value,
            slowest_mm_per_s,
        }
    }
}

/// The slowest move of a drive; 0 for one with a file of its own, which says it.
fn slowest(instrument: Option<&Named<DriveMake>>, scale: &Scale<Mm>) -> f64 {
    match instrument {
        Some(Named::Shipped(make)) => RegisterMap::of(*make).speed.slowest_per_s(scale),
        Some(Named::File { .. }) | None => 0.0,
    }
}

/// Checks each speed against its limit.
fn speeds(table: &Table<'_>, limits: &LimitsRead, linear: &AxisRead<Mm>, rotary: &AxisRead<Deg>) {
    let pairs = [
        (&limits.travel_speed_mm_per_s, &linear.max_speed),
        (&limits.contact_speed_mm_per_s, &limits.travel_speed_mm_per_s),
        (&limits.rotary_speed_deg_per_s, &rotary.max_speed),
    ];
    for (speed, highest) in pairs {
        if let (Some(&found), Some(&limit)) = (speed.sound(), highest.sound())
            && found > limit
        {
            let (key, limit_key) = (speed.key, highest.key);
            table.refuse(speed, &RigFileFault::TooFast { key, found, limit_key, limit });
        }
    }
}

/// Checks that the clear position is above every point of a tilted sample, and that the linear stage
/// reaches the deepest indentation.
fn heights(
    table: &Table<'_>,
    geometry: &GeometryRead,
    limits: &LimitsRead,
    linear: &AxisRead<Mm>,
    rotary: &AxisRead<Deg>,
) {
    if !geometry.is_sound {
        return;
    }
    if let (Some(&clear), Some(&(min, max))) = (linear.rest.sound(), rotary.soft_limits.sound()) {
        let highest = geometry.geometry.highest_sample_point(f64::max(min.abs(), max.abs()));
        if clear <= highest.value() {
            let reach_mm = linear.soft_limits.sound().map(|&(_, max)| max);
            table.refuse(&linear.rest, &RigFileFault::NotClear { clear, highest, reach_mm });
        }
    }
    if let (Some(pin), Some(&(min, max))) = (&geometry.pin_radius_mm, rotary.soft_limits.sound()) {
        let is_beside = |tilt: &f64| !geometry.geometry.is_above_pin(Position::new(*tilt));
        if let Some(tilt_deg) = [min, max].into_iter().find(is_beside) {
            let found = pin.value;
            table.refuse(pin, &RigFileFault::ThinPin { found, tilt_deg });
        }
    }
    if let (Some(&depth), Some(&(limit, _))) =
        (limits.max_indentation_mm.sound(), linear.soft_limits.sound())
    {
        let room = depth + geometry.geometry.surface_tolerance_mm;
        let found = geometry.surface_mm.value;
        if found - room < limit {
            table.refuse(&geometry.surface_mm, &RigFileFault::NoRoomBelow { found, room, limit });
        }
    }
}
