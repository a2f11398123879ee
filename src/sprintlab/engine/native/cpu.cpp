extern "C" void engine_step(const Buffers* buffers, int robots) {
#pragma omp parallel for schedule(static)
  for (int robot = 0; robot < robots; robot += LANES) {
    const Place place = { robot, robots - robot < LANES ? robots - robot : LANES };
    policy_step(*buffers, place);
  }
}
