extern "C" __global__ void __launch_bounds__(THREADS, 1) engine_step(const Buffers buffers, int robots) {
  const int thread = blockIdx.x * blockDim.x + threadIdx.x, robot = thread / LEGS;
  const Place place = { robot < robots ? robot : robots - 1, thread % LEGS, robot < robots };
  policy_step(buffers, place);
}
