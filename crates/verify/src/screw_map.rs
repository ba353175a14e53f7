//! The map of the screw in a cited calibration, held against the touches on blocks from which it was made.
//!
//! With the stated errors taken out of their heights, the touches have to lie on flat blocks as well as is stated of them
//! (χ²). The map is then fitted again, with the errors at its heights as unknowns of their own beside those of the geometry:
//! the stated ways between its heights have to be the ones found, and not better known than these touches let them be.
//!
//! By how much a block is higher than the first one is not in a calibration, and is an unknown here.

use rusqlite::{Connection, OptionalExtension, params};

use crate::{
    JournalError,
    finding::{Check, Findings},
    normal::Factor,
    record::{Record, Screw},
    screw::FiledMap,
    settings::{self, Settings},
};

/// Standard deviation of a tilt, as a part of the tolerance of the rotary stage.
const TILT_PART: f64 = 0.5;

/// What a smooth function leaves of the error of a screw at a height of a map, mm.
///
/// # Source
/// docs/decisions/0153: 1.9 µm of a way through an error whose direction changes each 0.3 mm.
const KINKS_MM: f64 = 0.001_3;

/// Standard deviations and lengths of the error of a screw that are tried, mm.
///
/// # Source
/// docs/decisions/0132.
const SIZES_MM: [f64; 5] = [0.000_3, 0.002, 0.006, 0.012, 0.025];
const LENGTHS_MM: [f64; 3] = [0.2, 0.45, 1.0];

/// Independent part of a random function, as a part of its variance: without it, its matrix is singular.
const NUGGET: f64 = 1e-6;

/// Largest χ² per degree of freedom: a calibration takes touches that scatter twice as much as stated.
const MISFIT: f64 = 4.0;

/// A way of a depth, in steps of a map: half a millimetre.
const WAY: usize = 5;

/// Smallest part of the standard deviation found that may be stated of a way, and largest difference of a stated way from the
/// one found, in standard deviations.
const LEAST_PART: f64 = 0.7;
const MOST_SIGMAS: f64 = 3.0;

/// Most heights of a map that is fitted again.
const MOST_HEIGHTS: usize = 250;

/// Steps of a fit: two or three lead to the end.
const STEPS: usize = 20;
const CONVERGED: f64 = 1e-8;

/// A touch on a block.
#[derive(Debug, Clone, Copy)]
struct Touch {
    /// Index of its run.
    run: usize,
    tilt_rad: f64,
    height_mm: f64,
}

/// The touches of some runs.
#[derive(Debug, Clone)]
struct Touches {
    all: Vec<Touch>,
    runs: usize,
    /// Standard deviations of a height and of a tilt.
    height_sigma_mm: f64,
    tilt_sigma_rad: f64,
}

/// Checks a map. Returns a note if its touches are not here.
///
/// # Errors
/// [`JournalError`] of SQLite.
pub(crate) fn check(
    connection: &Connection,
    map: &FiledMap<'_>,
    findings: &mut Findings,
) -> Result<Option<String>, JournalError> {
    if !map.screw.is_map() {
        return Ok(None);
    }
    let Some(touches) = Touches::read(connection, &map.runs)? else {
        let file = map.file;
        let note = format!(
            "the map of the screw from {file} is not fitted again: the touches of its runs are not here"
        );
        return Ok(Some(note));
    };
    judge(&touches, map, findings);
    Ok(None)
}

fn judge(touches: &Touches, map: &FiledMap<'_>, findings: &mut Findings) {
    let FiledMap { file, screw, .. } = map;
    let Some(misfit) = touches.misfit(screw) else {
        let what = format!("the map of the screw from {file}");
        findings.add(
            Check::Calibration,
            1,
            what,
            "the heights of all touches of its runs",
            "others",
        );
        return;
    };
    if misfit > MISFIT {
        let what = format!("χ² per degree of freedom of the touches from which {file} was made");
        let expected = "that of flat blocks, with the map of the screw taken out";
        findings.add(Check::Calibration, 1, what, expected, format!("{misfit:.1} > {MISFIT}"));
    }
    let Some(found) = touches.fit(&screw.heights_mm) else {
        let what = format!("the map of the screw from {file}");
        findings.add(Check::Calibration, 1, what, "one that can be fitted again", "another");
        return;
    };
    let ways = touches.ways(screw, &found);
    let total = |of: fn(&Way) -> f64| ways.iter().map(|way| of(way).powi(2)).sum::<f64>().sqrt();
    let (stated, carried) = (total(|way| way.stated_sigma_mm), total(|way| way.least_sigma_mm));
    if stated < LEAST_PART * carried {
        let rms_um = |total_mm: f64| 1e3 * total_mm / (ways.len() as f64).sqrt();
        let what = format!("standard deviation of a way of 0.5 mm by {file}, µm");
        let expected = format!("{:.2}, from its touches", rms_um(carried));
        findings.add(Check::Calibration, 1, what, expected, format!("{:.2}", rms_um(stated)));
    }
    let off = |way: &Way| (way.stated_mm - way.mm).abs() / way.sigma_mm;
    let worst = ways.iter().max_by(|a, b| off(a).total_cmp(&off(b)));
    if let Some(way) = worst.filter(|way| off(way) > MOST_SIGMAS) {
        let Way { from_mm, to_mm, .. } = way;
        let what = format!("error of the way from {from_mm:.2} to {to_mm:.2} mm by {file}, µm");
        let expected = format!("{:.1} ± {:.1}, from its touches", 1e3 * way.mm, 1e3 * way.sigma_mm);
        findings.add(Check::Calibration, 1, what, expected, format!("{:.1}", 1e3 * way.stated_mm));
    }
}

/// The error of a way between two heights of a map, as it is stated and as it is found.
#[derive(Debug, Clone, Copy)]
struct Way {
    from_mm: f64,
    to_mm: f64,
    stated_mm: f64,
    stated_sigma_mm: f64,
    mm: f64,
    sigma_mm: f64,
    /// Its standard deviation if the heights of the blocks are known.
    least_sigma_mm: f64,
}

/// A map that was fitted again.
#[derive(Debug, Clone)]
struct Map {
    errors_mm: Vec<f64>,
    covariance_mm2: Vec<Vec<f64>>,
}

/// The unknowns of the geometry: height of the level block, distance of its surface from the rotary axis with the radius of
/// the ball, probe beside that axis, mm, zero of the rotary stage, rad, and by how much each further block is higher, mm.
type Geometry = Vec<f64>;
const OF_BENCH: usize = 4;

impl Touches {
    /// The touches of runs; `None` where a run, or its readings, are not in this journal.
    fn read(connection: &Connection, runs: &[String]) -> Result<Option<Self>, JournalError> {
        let (mut all, mut squares, mut tolerance_deg) = (Vec::new(), 0.0, 0.0);
        for (run, id) in runs.iter().enumerate() {
            let key = connection
                .query_row("SELECT key FROM runs WHERE id = ?1", params![id], |row| row.get(0))
                .optional()?;
            let Some(key): Option<i64> = key else { return Ok(None) };
            let before = all.len();
            let mut records = connection.prepare(
                "SELECT payload FROM records WHERE run = ?1 AND kind IN ('run_started', 'surface_found') ORDER BY seq",
            )?;
            let mut rows = records.query(params![key])?;
            while let Some(row) = rows.next()? {
                let payload: String = row.get(0)?;
                match serde_json::from_str(&payload) {
                    Ok(Record::RunStarted(started)) => {
                        let Ok(settings) = Settings::read(&started) else { return Ok(None) };
                        tolerance_deg = settings.rig.rotary.tolerance_deg;
                    }
                    Ok(Record::SurfaceFound(found)) if found.pose.direction != "left" => {
                        let pose = &found.pose;
                        let tilt = settings::tilt_deg(&pose.direction, pose.angle_deg);
                        let Some(tilt_deg) = tilt else { return Ok(None) };
                        let (tilt_rad, height_mm) = (tilt_deg.to_radians(), found.position_mm);
                        all.push(Touch { run, tilt_rad, height_mm });
                        squares += found.sigma_mm.powi(2);
                    }
                    Ok(_) => {}
                    // Readings that were moved to an archive leave nothing.
                    Err(_) => return Ok(None),
                }
            }
            if all.len() == before {
                return Ok(None);
            }
        }
        let count = all.len();
        Ok((count > 0).then(|| Self {
            all,
            runs: runs.len(),
            height_sigma_mm: (squares / count as f64).sqrt(),
            tilt_sigma_rad: (TILT_PART * tolerance_deg).to_radians(),
        }))
    }

    /// χ² per degree of freedom of the touches about flat blocks, with the errors of a map taken out of their heights; `None`
    /// where a touch is outside of the map, or nothing is found.
    fn misfit(&self, screw: &Screw) -> Option<f64> {
        let errors = self.all.iter().map(|touch| {
            let (at, [low, high]) = weights(&screw.heights_mm, touch.height_mm)?;
            Some(low * screw.errors_mm[at] + high * screw.errors_mm[at + 1])
        });
        let errors: Vec<f64> = errors.collect::<Option<_>>()?;
        let mut geometry = self.start();
        for _ in 0..STEPS {
            let size = geometry.len();
            let (mut left, mut right) = (vec![vec![0.0; size]; size], vec![0.0; size]);
            let mut squares = 0.0;
            for (touch, error_mm) in self.all.iter().zip(&errors) {
                let (expected, row) = expected(&geometry, touch, self.runs);
                let off = touch.height_mm - error_mm - expected;
                let weight = 1.0 / (self.variance(row[3]) + KINKS_MM.powi(2));
                squares += weight * off * off;
                for i in 0..size {
                    right[i] += weight * row[i] * off;
                    for j in 0..size {
                        left[i][j] += weight * row[i] * row[j];
                    }
                }
            }
            let step = Factor::new(left)?.solve(&right);
            if step.iter().all(|step| step.abs() < CONVERGED) {
                let degrees = self.all.len().checked_sub(size).filter(|degrees| *degrees > 0)?;
                return Some(squares / degrees as f64);
            }
            geometry.iter_mut().zip(&step).for_each(|(value, step)| *value += step);
        }
        None
    }

    /// Fits the map at these heights: first with the heights of the blocks as unknowns, and then with those that were found,
    /// because a person has told them to the calibration. The first one is right, the second one as sure as a map can be.
    fn fit(&self, heights_mm: &[f64]) -> Option<[Map; 2]> {
        if heights_mm.len() > MOST_HEIGHTS {
            return None;
        }
        let (geometry, map) = self.average(heights_mm, &self.start(), self.runs - 1)?;
        let (_, surest) = self.average(heights_mm, &geometry, 0)?;
        Some([map, surest])
    }

    /// The mean over the assumptions about the screw, by how well they explain the touches; `further` is the number of heights
    /// of blocks that are unknown.
    fn average(
        &self,
        heights_mm: &[f64],
        start: &[f64],
        further: usize,
    ) -> Option<(Geometry, Map)> {
        let mut geometry = start.to_vec();
        let mut all = Vec::new();
        for sigma_mm in SIZES_MM {
            for length_mm in LENGTHS_MM {
                let assumed = (sigma_mm, length_mm);
                let fitted = self.with_screw(heights_mm, &geometry, assumed, further);
                let Some(fitted) = fitted else { continue };
                geometry.clone_from(&fitted.geometry);
                all.push(fitted);
            }
        }
        let highest = all.iter().map(|one| one.log_weight).fold(f64::NEG_INFINITY, f64::max);
        let total: f64 = all.iter().map(|one| (one.log_weight - highest).exp()).sum();
        if all.is_empty() {
            return None;
        }
        let share = |one: &Fitted| (one.log_weight - highest).exp() / total;
        let sum = |of: &dyn Fn(&Fitted) -> f64| all.iter().map(|one| share(one) * of(one)).sum();
        let count = heights_mm.len();
        let errors_mm: Vec<f64> = (0..count).map(|i| sum(&|one: &Fitted| one.errors[i])).collect();
        let entry = |i: usize, j: usize| -> f64 {
            let kinks = if i == j { KINKS_MM.powi(2) } else { 0.0 };
            kinks
                + sum(&|one: &Fitted| {
                    let off = |i: usize| one.errors[i] - errors_mm[i];
                    one.covariance[i][j] + off(i) * off(j)
                })
        };
        let covariance_mm2 = (0..count).map(|i| (0..count).map(|j| entry(i, j)).collect());
        let covariance_mm2 = covariance_mm2.collect();
        let geometry = (0..start.len()).map(|i| sum(&|one: &Fitted| one.geometry[i])).collect();
        Some((geometry, Map { errors_mm, covariance_mm2 }))
    }

    /// The geometry and the errors at heights with one assumption about the screw, as unknowns of one system of equations.
    fn with_screw(
        &self,
        heights_mm: &[f64],
        start: &[f64],
        (sigma_mm, length_mm): (f64, f64),
        further: usize,
    ) -> Option<Fitted> {
        let known = Factor::new(random(heights_mm, sigma_mm, length_mm))?;
        let precision = known.inverse();
        let (own, count) = (OF_BENCH + further, heights_mm.len());
        let mut geometry = start.to_vec();
        for _ in 0..STEPS {
            let size = own + count;
            let (mut left, mut right) = (vec![vec![0.0; size]; size], vec![0.0; size]);
            for (i, row) in precision.iter().enumerate() {
                left[own + i][own..].copy_from_slice(row);
            }
            let mut rows = Vec::new();
            let mut log_noise = 0.0;
            for touch in &self.all {
                let (expected, row) = expected(&geometry, touch, self.runs);
                let (at, [low, high]) = weights(heights_mm, touch.height_mm)?;
                let variance = self.variance(row[3]);
                let mut sparse: Vec<(usize, f64)> = row.into_iter().take(own).enumerate().collect();
                sparse.extend([(own + at, low), (own + at + 1, high)]);
                let off = touch.height_mm - expected;
                for (i, a) in &sparse {
                    right[*i] += a * off / variance;
                    for (j, b) in &sparse {
                        left[*i][*j] += a * b / variance;
                    }
                }
                log_noise += variance.ln();
                rows.push((sparse, off, variance));
            }
            let factor = Factor::new(left)?;
            let solved = factor.solve(&right);
            let (step, errors) = solved.split_at(own);
            if step.iter().all(|step| step.abs() < CONVERGED) {
                let of_touches: f64 = rows
                    .iter()
                    .map(|(sparse, off, variance)| {
                        let explained: f64 = sparse.iter().map(|(i, a)| a * solved[*i]).sum();
                        (off - explained).powi(2) / variance
                    })
                    .sum();
                let of_screw: f64 =
                    precision.iter().zip(errors).map(|(row, e)| e * dot(row, errors)).sum();
                let determinants = log_noise + known.log_determinant() + factor.log_determinant();
                let inverse = factor.inverse();
                let covariance = inverse[own..].iter().map(|row| row[own..].to_vec()).collect();
                let log_weight = -0.5 * (determinants + of_touches + of_screw);
                return Some(Fitted { geometry, errors: errors.to_vec(), covariance, log_weight });
            }
            geometry.iter_mut().zip(step).for_each(|(value, step)| *value += step);
            if geometry[3].abs() > 0.8 {
                return None;
            }
        }
        None
    }

    /// The ways of a depth between heights of a map that were touched.
    fn ways(&self, screw: &Screw, [found, surest]: &[Map; 2]) -> Vec<Way> {
        let heights = self.all.iter().map(|touch| touch.height_mm);
        let ends = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), height| {
            (low.min(height), high.max(height))
        });
        let stated = |i: usize, j: usize| screw.covariance_um2[i.max(j)][i.min(j)];
        let way = |low: usize| {
            let high = low + WAY;
            let [from_mm, to_mm] = [low, high].map(|index| screw.heights_mm[index]);
            let sigma_mm = |map: &Map| {
                let own = &map.covariance_mm2;
                (own[low][low] + own[high][high] - 2.0 * own[low][high]).max(0.0).sqrt()
            };
            let stated_um2 = stated(low, low) + stated(high, high) - 2.0 * stated(low, high);
            (ends.0 <= from_mm && to_mm <= ends.1).then(|| Way {
                from_mm,
                to_mm,
                stated_mm: screw.errors_mm[high] - screw.errors_mm[low],
                stated_sigma_mm: 1e-3 * stated_um2.max(0.0).sqrt(),
                mm: found.errors_mm[high] - found.errors_mm[low],
                sigma_mm: sigma_mm(found),
                least_sigma_mm: sigma_mm(surest),
            })
        };
        (0..screw.heights_mm.len().saturating_sub(WAY)).filter_map(way).collect()
    }

    /// A start: the level touches, and the middle of what benches have.
    fn start(&self) -> Geometry {
        let level = |run: usize| {
            let touches = self.all.iter().filter(|touch| touch.run == run);
            let level = touches.min_by(|a, b| a.tilt_rad.abs().total_cmp(&b.tilt_rad.abs()));
            level.map_or(0.0, |touch| touch.height_mm)
        };
        let first = level(0);
        let mut start = vec![first, 4.0, 0.0, 0.0];
        start.extend((1..self.runs).map(|run| level(run) - first));
        start
    }

    /// Variance of a height whose derivative by the tilt is this, mm².
    fn variance(&self, by_tilt: f64) -> f64 {
        self.height_sigma_mm.powi(2) + (self.tilt_sigma_rad * by_tilt).powi(2)
    }
}

/// A fit with one assumption about the screw.
struct Fitted {
    geometry: Geometry,
    errors: Vec<f64>,
    covariance: Vec<Vec<f64>>,
    log_weight: f64,
}

/// The height at which the ball touches a block, mm, and its derivatives by the geometry.
fn expected(geometry: &[f64], touch: &Touch, runs: usize) -> (f64, Vec<f64>) {
    let [surface, from_axis, beside, zero] = [0, 1, 2, 3].map(|index: usize| geometry[index]);
    let raised = touch.run.checked_sub(1).map_or(0.0, |index| geometry[OF_BENCH + index]);
    let (sin, cos) = (touch.tilt_rad + zero).sin_cos();
    // The distance of the centre of the ball from the plane through the rotary axis, along its normal.
    let normal = from_axis + raised;
    let height = surface - from_axis + (normal - beside * sin) / cos;
    let by_tilt = (normal * sin - beside) / (cos * cos);
    let mut row = vec![1.0, 1.0 / cos - 1.0, -sin / cos, by_tilt];
    let of_run = |run: usize| if run == touch.run { 1.0 / cos } else { 0.0 };
    row.extend((1..runs).map(of_run));
    (height, row)
}

/// The cell of a height, and the weights of both of its ends; `None` outside.
fn weights(heights_mm: &[f64], at_mm: f64) -> Option<(usize, [f64; 2])> {
    let cell = heights_mm.windows(2).position(|pair| pair[0] <= at_mm && at_mm <= pair[1])?;
    let part = (at_mm - heights_mm[cell]) / (heights_mm[cell + 1] - heights_mm[cell]);
    Some((cell, [1.0 - part, part]))
}

/// The covariance of a smooth random function at heights, mm².
fn random(heights_mm: &[f64], sigma_mm: f64, length_mm: f64) -> Vec<Vec<f64>> {
    let entry = |a: f64, b: f64| {
        let own = if a == b { NUGGET } else { 0.0 };
        sigma_mm.powi(2) * (own + (-0.5 * ((a - b) / length_mm).powi(2)).exp())
    };
    heights_mm.iter().map(|a| heights_mm.iter().map(|b| entry(*a, *b)).collect()).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An error of 10 µm with a period of 2 mm, and noise of a micrometre that repeats itself.
    fn touches() -> Touches {
        let mut all = Vec::new();
        for (run, raised) in [(0, 0.0), (1, -0.7)] {
            for step in -18..=18 {
                let secant: f64 = 1.0 + 0.023 * f64::from(i32::abs(step));
                let tilt_rad = f64::from(step.signum()) * secant.recip().acos();
                let touch = Touch { run, tilt_rad, height_mm: 0.0 };
                let (height, _) = expected(&[10.0, 4.5, 0.3, 0.002, raised], &touch, 2);
                let error = 0.01 * (std::f64::consts::PI * height).sin();
                let noise = 0.001 * (7.3 * f64::from(step) + f64::from(u8::from(run == 1))).sin();
                all.push(Touch { height_mm: height + error + noise, ..touch });
            }
        }
        Touches { all, runs: 2, height_sigma_mm: 0.001, tilt_sigma_rad: 0.000_17 }
    }

    /// A map as it is stated, from its own fit.
    fn stated(touches: &Touches) -> Screw {
        let heights = touches.all.iter().map(|touch| touch.height_mm);
        let low = heights.clone().fold(f64::INFINITY, f64::min) - 0.1;
        let high = heights.fold(f64::NEG_INFINITY, f64::max) + 0.1;
        let all = (0..100).map(|step| low + 0.1 * f64::from(step));
        let heights_mm: Vec<f64> = all.take_while(|height| *height < high + 0.1).collect();
        let [_, Map { errors_mm, covariance_mm2 }] = touches.fit(&heights_mm).unwrap();
        let row = |(index, row): (usize, &Vec<f64>)| {
            row[..=index].iter().map(|entry| 1e6 * entry).collect()
        };
        let covariance_um2 = covariance_mm2.iter().enumerate().map(row).collect();
        Screw { heights_mm, errors_mm, covariance_um2 }
    }

    #[track_caller]
    fn check(screw: &Screw, expected: &[&str]) {
        let mut findings = Findings::default();
        let map = FiledMap { file: "blocks-1.toml", screw, runs: Vec::new() };
        judge(&touches(), &map, &mut findings);
        let found: Vec<_> = findings.0.iter().map(ToString::to_string).collect();
        assert_eq!(found.len(), expected.len(), "{found:?}");
        for (found, expected) in found.iter().zip(expected) {
            assert!(found.contains(expected), "{found}");
        }
    }

    #[test]
    fn a_map_that_its_touches_bear_is_sound_and_finds_the_error_of_the_screw() {
        let touches = touches();
        let screw = stated(&touches);
        check(&screw, &[]);
        let misfit = touches.misfit(&screw).unwrap();
        assert!(misfit < 1.0, "{misfit}");
        let error = |at_mm: f64| 0.01 * (std::f64::consts::PI * at_mm).sin();
        for way in touches.ways(&screw, &touches.fit(&screw.heights_mm).unwrap()) {
            let off = way.mm - (error(way.to_mm) - error(way.from_mm));
            assert!(off.abs() < 3.0 * way.sigma_mm, "{way:?} {off}");
        }
    }

    #[test]
    fn a_map_that_is_shifted_in_a_part_bent_or_too_sure_is_found() {
        let honest = stated(&touches());
        let mut shifted = honest.clone();
        shifted.errors_mm[8..13].iter_mut().for_each(|error| *error += 0.02);
        check(&shifted, &["χ² per degree of freedom", "error of the way"]);
        // The touches cannot tell a straight line from the distance of the surface from the rotary axis.
        let mut bent = honest.clone();
        for (error, height) in bent.errors_mm.iter_mut().zip(&honest.heights_mm) {
            *error += 0.03 * (height - 10.0);
        }
        check(&bent, &["error of the way"]);
        let mut sure = honest.clone();
        sure.covariance_um2.iter_mut().flatten().for_each(|entry| *entry *= 0.25);
        check(&sure, &["standard deviation of a way of 0.5 mm"]);
        let mut short = honest;
        for list in [&mut short.heights_mm, &mut short.errors_mm] {
            list.truncate(10);
        }
        check(&short, &["the heights of all touches"]);
    }
}
