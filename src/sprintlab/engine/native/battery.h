// The bus that all joints share: a second form of motors.battery; a test proves them equal.
struct Pack { number charge, voltage; };  // state of charge; bus voltage of the last turn of the motor loop

FUNCTION number open_circuit(number charge) {
  number voltage = splat(CELL_VOLTAGE[0]);
  UNROLL for (int i = 1; i < CELL_POINTS; i++) {
    const number passed = smaller(larger(charge - CELL_CHARGE[i - 1], splat(S(0))), splat(CELL_CHARGE[i] - CELL_CHARGE[i - 1]));
    voltage = voltage + passed * ((CELL_VOLTAGE[i] - CELL_VOLTAGE[i - 1]) / (CELL_CHARGE[i] - CELL_CHARGE[i - 1]));
  }
  return voltage;
}
FUNCTION number loaded(number source, number power) {
  const number squared = source * source - S(4 * PACK_RESISTANCE) * power;
  return smaller(S(0.5) * (source + root(larger(squared, splat(S(0))))), source + S(PACK_RESISTANCE * REGENERATION_LIMIT));
}
// Where `voltage - loaded(power(voltage))` vanishes, by secants held inside of their bracket
template <typename Power> FUNCTION number shared_voltage(const Pack& pack, const Power& power) {
  const number source = open_circuit(pack.charge);
  number low = S(0.5) * source, high = source + S(PACK_RESISTANCE * REGENERATION_LIMIT);
  number older = smaller(larger(pack.voltage, low), high), older_error = older - loaded(source, power(older));
  number voltage = smaller(larger(older - older_error, low), high);
#pragma unroll 1
  for (int i = 0; i < BUS_STEPS; i++) {
    const number error = voltage - loaded(source, power(voltage));
    low = if_greater(error, splat(S(0)), low, voltage);
    high = if_greater(error, splat(S(0)), voltage, high);
    const number apart = voltage - older, far = if_greater(magnitude(apart), S(1e-6) * voltage, splat(S(1)), splat(S(0)));
    const number slope = (error - older_error) * reciprocal(if_greater(far, splat(S(0)), apart, splat(S(1))));
    const number secant = voltage - error * reciprocal(larger(if_greater(far, splat(S(0)), slope, splat(S(1))), splat(S(0.1))));
    const number middle = S(0.5) * (low + high);
    older = voltage;
    older_error = error;
    voltage = if_greater(secant, low, if_greater(high, secant, secant, middle), middle);
    voltage = if_greater(magnitude(error), splat(S(1e-4)), voltage, older);
  }
  return voltage;
}
FUNCTION void discharge(Pack& pack, number power) {
  const number current = larger(power * reciprocal(pack.voltage), splat(S(-REGENERATION_LIMIT)));
  pack.charge = smaller(larger(pack.charge - current * S(CHARGE_PER_AMPERE), splat(S(0))), splat(S(1)));
}
