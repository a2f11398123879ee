// The motor law of sprintlab.motors for a page: SI, motor side, i_d = 0. A test holds it against Python.
"use strict";

const motorLaw = {
  UTILIZATION: 0.95,

  voltage(bus) { return motorLaw.UTILIZATION * bus / Math.sqrt(3); },

  torqueConstant(motor) { return 1.5 * motor.polePairs * motor.flux; },

  // Flux linkage [Wb] of a speed constant [rpm/V], line to line, peak.
  fluxOfKv(kv, polePairs) { return 60 / (2 * Math.PI * Math.sqrt(3) * polePairs * kv); },

  noLoadSpeed(motor, bus) { return motorLaw.voltage(bus) / (motor.polePairs * motor.flux); },

  // Least and greatest torque at a speed [rad/s]; model "refined", "simplified-dc" or "square".
  limits(motor, speed, bus, model) {
    const peak = motorLaw.torqueConstant(motor) * motor.peakCurrent;
    if (model === "square") return [-peak, peak];
    const w = motor.polePairs * speed, R = motor.resistance, psi = motor.flux;
    const L = model === "simplified-dc" ? 0 : motor.inductance;
    const Z2 = R * R + w * w * L * L, V = motorLaw.voltage(bus);
    const middle = -R * w * psi / Z2;
    const root = Z2 * V * V - w ** 4 * L * L * psi * psi;
    const half = root > 0 ? Math.sqrt(root) / Z2 : 0;
    const clip = (current) => motorLaw.torqueConstant(motor) * Math.min(Math.max(current, -motor.peakCurrent), motor.peakCurrent);
    return [clip(middle - half), clip(middle + half)];
  },

  // Highest speed [rad/s] at which a driving current [A] still fits the voltage; 0 where it never does.
  criticalSpeed(motor, current, bus, model) {
    if (model === "square") return Infinity;
    const L = model === "simplified-dc" ? 0 : motor.inductance, R = motor.resistance, V = motorLaw.voltage(bus);
    const a = motor.flux ** 2 + (L * current) ** 2, b = R * current * motor.flux, c = (R * current) ** 2 - V * V;
    return c > 0 ? 0 : -c / (b + Math.sqrt(b * b - a * c)) / motor.polePairs;
  },
};

if (typeof module !== "undefined") module.exports = motorLaw;
