// The equivalent circuit of the sensor, as docs/architecture.md and the journal have it.
import type { Circuit, Reading } from "./wire.ts";

export interface Complex { re: number; im: number }

/** Y = jωC₀ [(1 − j tan δ) + m / (1 − u² + j u/Q)] with u = f/fᵣ, in siemens. */
export function admittance(circuit: Circuit & { resonance_hz: number }, frequency_hz: number): Complex {
  const u = frequency_hz / circuit.resonance_hz;
  const [a, b] = [1 - u * u, u / circuit.quality_factor];
  const m = circuit.capacitance_ratio / (a * a + b * b);
  const [re, im] = [1 + m * a, -circuit.loss_tangent - m * b];
  const scale = 2 * Math.PI * frequency_hz * circuit.static_capacitance_f;
  return { re: -scale * im, im: scale * re };
}

export function inverse({ re, im }: Complex): Complex {
  const square = re * re + im * im;
  return { re: re / square, im: -im / square };
}

export const impedanceOf = (reading: Reading): Complex => ({
  re: reading.resistance_ohm,
  im: reading.reactance_ohm,
});

export const magnitude = ({ re, im }: Complex) => Math.hypot(re, im);
export const phaseDeg = ({ re, im }: Complex) => (Math.atan2(im, re) * 180) / Math.PI;
