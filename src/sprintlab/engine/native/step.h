// One policy step of the robots of one Place: all substeps, their monitors, then where the feet are.
struct Joint { Control control; Driven driven; JointWatch watch; };
struct Leg {
  number q[LINKS], qd[LINKS], tau[LINKS], kept[KEPT], foot[FOOT_VALUES], bristle[2];
  scalar constants[LEG_CONSTANTS];
  Joint joints[DRIVES];
  FootWatch watch;
  Touch touch;
};
struct Robot {
  Trunk trunk;
  Mass mass;
  Pad pad;
  Supplied supplied;
  number step, delay, stride, stance;
  number near[PAIR_SLOTS * LEGS_HERE], power;
  Leg legs[LEGS_HERE];
#ifdef BATTERY
  Pack pack;
#endif
#ifdef WAIST
  number q[1], qd[1], tau[1], kept[WAIST_KEPT + 1];
  Joint joint;
#endif
};

FUNCTION number parameter(const Buffers& buffers, int column, Place place) {
  return read(buffers.parameters, PARAMETERS, column, place);
}
FUNCTION void read_joint(const Buffers& buffers, int joint, Place place, Joint& into) {
  Control& control = into.control;
  control.target = read(buffers.target, JOINTS, joint, place);
  control.stiffness = read(buffers.stiffness, JOINTS, joint, place);
  control.damping = read(buffers.damping, JOINTS, joint, place);
  control.strength = read(buffers.strength, JOINTS, joint, place);
  control.previous = read(buffers.previous_target, JOINTS, joint, place);
#ifdef HEAT
  control.temperature = read(buffers.winding_temperature, JOINTS, joint, place);
#endif
#ifdef I2T
  control.level = read(buffers.i2t_level, JOINTS, joint, place);
#endif
  JointWatch& watch = into.watch;
  watch.limited = watch.depth = watch.speed = watch.gear = splat(S(0));
}
FUNCTION void write_joint(const Buffers& buffers, int joint, Place place, const Joint& from, const Drive& drive) {
  write(buffers.torque, JOINTS, joint, from.driven.delivered, place);
  write(buffers.limit_share, JOINTS, joint, from.watch.limited * S(1.0 / SUBSTEPS), place);
  write(buffers.stop_depth, JOINTS, joint, from.watch.depth, place);
  write(buffers.joint_speed, JOINTS, joint, from.watch.speed * drive.inverse_no_load, place);
  write(buffers.gear_torque, JOINTS, joint, from.watch.gear * (drive.inverse_peak / BIN), place);
#ifdef HEAT
  write(buffers.winding_temperature, JOINTS, joint, from.control.temperature, place);
#endif
#ifdef I2T
  write(buffers.i2t_level, JOINTS, joint, from.control.level, place);
#endif
}

FUNCTION void read_robot(const Buffers& buffers, Place place, Robot& robot) {
  Trunk& trunk = robot.trunk;
  UNROLL for (int i = 0; i < 3; i++) {
    trunk.position[i] = read(buffers.qpos, NQ, i, place);
    trunk.v[i] = read(buffers.qvel, NV, i, place);
    trunk.w[i] = read(buffers.qvel, NV, 3 + i, place);
    robot.mass.gravity[i] = parameter(buffers, GRAVITY_X + i, place);
  }
  UNROLL for (int i = 0; i < 4; i++) trunk.quaternion[i] = read(buffers.qpos, NQ, 3 + i, place);
  Mass& mass = robot.mass;
  const number m = mass.mass = parameter(buffers, TRUNK_MASS, place);
  const number x = parameter(buffers, TRUNK_CENTER_X, place), y = parameter(buffers, TRUNK_CENTER_Y, place), z = parameter(buffers, TRUNK_CENTER_Z, place);
  mass.lever[0] = m * x; mass.lever[1] = m * y; mass.lever[2] = m * z;
  const number about[6] = { m * (y * y + z * z), -m * x * y, -m * x * z, m * (x * x + z * z), -m * y * z, m * (x * x + y * y) };
  UNROLL for (int i = 0; i < 6; i++) mass.inertia[i] = about[i] + TRUNK_INERTIA[i];
  mass.drag_area = parameter(buffers, DRAG_AREA, place);
  robot.pad.stiffness = parameter(buffers, PAD_STIFFNESS, place);
  robot.pad.damping = parameter(buffers, PAD_DAMPING, place);
  robot.pad.friction = parameter(buffers, FRICTION, place);
  robot.pad.drag = root(robot.pad.stiffness * S(LEG_MASS));  // FootContact.tangential_damping
  robot.supplied.voltage = parameter(buffers, VOLTAGE, place);
  robot.supplied.resistance_factor = parameter(buffers, RESISTANCE_FACTOR, place);
  robot.supplied.friction_factor = parameter(buffers, FRICTION_FACTOR, place);
  robot.step = parameter(buffers, TIMESTEP, place);
  robot.delay = read_whole(buffers.delay, place);
  robot.stride = splat(buffers.shortest[0]);
  robot.stance = splat(buffers.shortest[1]);
  UNROLL for (int i = 0; i < PAIR_SLOTS * LEGS_HERE; i++) robot.near[i] = splat(S(1e6));
  robot.power = splat(S(0));
#ifdef BATTERY
  robot.pack.charge = read(buffers.state_of_charge, 1, 0, place);
  robot.pack.voltage = read(buffers.bus_voltage, 1, 0, place);
#endif
#ifdef WAIST
  robot.q[0] = read(buffers.qpos, NQ, WAIST_QPOS, place);
  robot.qd[0] = read(buffers.qvel, NV, WAIST_QVEL, place);
  read_joint(buffers, WAIST_JOINT, place, robot.joint);
#endif
}

FUNCTION void read_leg(const Buffers& buffers, Place place, int l, Leg& leg) {
  UNROLL for (int i = 0; i < LINKS; i++) {
    leg.q[i] = read(buffers.qpos, NQ, QPOS[l * LINKS + i], place);
    leg.qd[i] = read(buffers.qvel, NV, QVEL[l * LINKS + i], place);
    leg.tau[i] = splat(S(0));
  }
  UNROLL for (int i = 0; i < LEG_CONSTANTS; i++) leg.constants[i] = LEG_TABLE[l * LEG_CONSTANTS + i];
  UNROLL for (int i = 0; i < DRIVES; i++) read_joint(buffers, DRIVE_JOINT[l * DRIVES + i], place, leg.joints[i]);
  UNROLL for (int i = 0; i < 2; i++) leg.bristle[i] = read(buffers.bristle, LEGS * 2, l * 2 + i, place);
  FootWatch& watch = leg.watch;
  watch.force = watch.deflection = watch.stance = watch.touchdowns = watch.hasty = watch.brief = splat(S(0));
  UNROLL for (int i = 0; i < WINDOW - 1; i++) watch.recent[i] = S(BIN) * read(buffers.recent_force, LEGS * (WINDOW - 1), l * (WINDOW - 1) + i, place);
  watch.loaded = read(buffers.loaded, LEGS, l, place);
  watch.since = read(buffers.since_touchdown, LEGS, l, place);
  watch.carried = read(buffers.carried, LEGS, l, place);
}

FUNCTION void write_leg(const Buffers& buffers, Place place, int l, Leg& leg, const Trunk& trunk, const number* m) {
  UNROLL for (int i = 0; i < LINKS; i++) {
    write(buffers.qpos, NQ, QPOS[l * LINKS + i], leg.q[i], place);
    write(buffers.qvel, NV, QVEL[l * LINKS + i], leg.qd[i], place);
  }
  UNROLL for (int i = 0; i < DRIVES; i++)
    write_joint(buffers, DRIVE_JOINT[l * DRIVES + i], place, leg.joints[i], leg_drive(i, leg.constants));
  UNROLL for (int i = 0; i < 2; i++) write(buffers.bristle, LEGS * 2, l * 2 + i, leg.bristle[i], place);
  const FootWatch& watch = leg.watch;
  UNROLL for (int i = 0; i < WINDOW - 1; i++) write(buffers.recent_force, LEGS * (WINDOW - 1), l * (WINDOW - 1) + i, watch.recent[i] * S(1.0 / BIN), place);
  write(buffers.foot_force, LEGS, l, watch.force * S(1.0 / (WINDOW * BIN)) * reciprocal(parameter(buffers, WEIGHT, place)), place);
  write(buffers.pad_deflection, LEGS, l, watch.deflection, place);
  write(buffers.stance, LEGS, l, watch.stance * S(1.0 / SUBSTEPS), place);
  write(buffers.touchdowns, LEGS, l, watch.touchdowns, place);
  write(buffers.hasty_touchdowns, LEGS, l, watch.hasty, place);
  write(buffers.short_stances, LEGS, l, watch.brief, place);
  write(buffers.loaded, LEGS, l, watch.loaded, place);
  write(buffers.since_touchdown, LEGS, l, watch.since, place);
  write(buffers.carried, LEGS, l, watch.carried, place);
  UNROLL for (int i = 0; i < 3; i++) {
    const number *knee = leg.foot + 10, *foot = leg.foot + 13;
    write(buffers.contact_force, LEGS * 3, l * 3 + i, leg.touch.force[i], place);
    write(buffers.foot_velocity, LEGS * 3, l * 3 + i, leg.foot[4 + i], place);
    write(buffers.foot_position, LEGS * 3, l * 3 + i, trunk.position[i] + m[3 * i] * foot[0] + m[3 * i + 1] * foot[1] + m[3 * i + 2] * foot[2], place);
    write(buffers.knee_position, LEGS * 3, l * 3 + i, trunk.position[i] + m[3 * i] * knee[0] + m[3 * i + 1] * knee[1] + m[3 * i + 2] * knee[2], place);
  }
}

FUNCTION void write_robot(const Buffers& buffers, Place place, const Robot& robot, const number* acceleration) {
  if (first_leg(place)) {
    const Trunk& trunk = robot.trunk;
    UNROLL for (int i = 0; i < 3; i++) {
      write(buffers.qpos, NQ, i, trunk.position[i], place);
      write(buffers.qvel, NV, i, trunk.v[i], place);
      write(buffers.qvel, NV, 3 + i, trunk.w[i], place);
    }
    UNROLL for (int i = 0; i < 4; i++) write(buffers.qpos, NQ, 3 + i, trunk.quaternion[i], place);
    write(buffers.power, 1, 0, robot.power * S(1.0 / SUBSTEPS), place);
#ifdef BATTERY
    write(buffers.state_of_charge, 1, 0, robot.pack.charge, place);
    write(buffers.bus_voltage, 1, 0, robot.pack.voltage, place);
#endif
#ifdef GIVEN_TORQUE
    UNROLL for (int i = 0; i < 6; i++) write(buffers.qacc, NV, i, acceleration[i], place);
#endif
#ifdef WAIST
    write(buffers.qpos, NQ, WAIST_QPOS, robot.q[0], place);
    write(buffers.qvel, NV, WAIST_QVEL, robot.qd[0], place);
    write_joint(buffers, WAIST_JOINT, place, robot.joint, waist_drive());
#endif
  }
}

// Where a leg hangs: on the trunk, or on the rear trunk
FUNCTION Carrier carrier_of_leg(const Carrier& front, const Carrier& rear, int l) {
#ifdef WAIST
  return l < REAR_LEG ? front : rear;
#else
  return front;
#endif
}
FUNCTION Carrier rear_carrier(const Carrier& front, Robot& robot) {
#ifdef WAIST
  number rear[22];
  waist_forward(front, robot.q, robot.qd, robot.kept, rear);
  Carrier carrier;
  UNROLL for (int i = 0; i < 3; i++) {
    carrier.w[i] = rear[i]; carrier.v[i] = rear[3 + i]; carrier.alpha[i] = rear[6 + i]; carrier.b[i] = rear[9 + i];
    carrier.x[i] = rear[12 + i]; carrier.z[i] = rear[15 + i]; carrier.g[i] = rear[18 + i];
  }
  carrier.height = rear[21];
  return carrier;
#else
  return front;
#endif
}
// Hips, knees and feet of rear legs in the trunk's frame
FUNCTION void place_leg(Robot& robot, int l, number* foot) {
#ifdef WAIST
  UNROLL for (int point = 7; point < FOOT_VALUES; point += 3) {
    number place[3];
    waist_place(foot + point, robot.kept, place);
    UNROLL for (int i = 0; i < 3; i++) foot[point + i] = l < REAR_LEG ? foot[point + i] : place[i];
  }
#endif
}

FUNCTION void watch_distances(Robot& robot, Place place) {
  number places[LEGS_HERE][9];
  UNROLL for (int i = 0; i < LEGS_HERE; i++) UNROLL for (int c = 0; c < 9; c++) places[i][c] = robot.legs[i].foot[7 + c];
  UNROLL for (int slot = 0; slot < PAIR_SLOTS; slot++)
    UNROLL for (int i = 0; i < LEGS_HERE; i++) {
      const int nominal = slot * LEGS + leg_number(i, place), pair = nominal < PAIRS ? nominal : PAIRS - 1;
      number one[9], two[9];
      UNROLL for (int c = 0; c < 9; c++) {
        one[c] = of_leg(places, PAIR_LEGS[2 * pair], c, place);
        two[c] = of_leg(places, PAIR_LEGS[2 * pair + 1], c, place);
      }
      number& near = robot.near[slot * LEGS_HERE + i];
      near = smaller(near, leg_distance(one, two));
    }
}
FUNCTION void write_distances(const Buffers& buffers, Place place, const Robot& robot) {
  UNROLL for (int slot = 0; slot < PAIR_SLOTS; slot++)
    UNROLL for (int i = 0; i < LEGS_HERE; i++) {
      const int pair = slot * LEGS + leg_number(i, place);
      if (pair < PAIRS) write(buffers.leg_distance, PAIRS, pair, robot.near[slot * LEGS_HERE + i], place);
    }
}

FUNCTION void sense(Robot& robot, const Carrier& front, const Carrier& rear, Place place) {
  UNROLL for (int i = 0; i < LEGS_HERE; i++) {
    Leg& leg = robot.legs[i];
    const Carrier carrier = carrier_of_leg(front, rear, leg_number(i, place));
    leg_forward(carrier, leg.q, leg.qd, leg.constants, leg.kept, leg.foot);
    place_leg(robot, leg_number(i, place), leg.foot);
  }
}

#ifdef BATTERY
FUNCTION number drawn_by(const Drive& drive, const Supplied& supplied, const Control& control, number q, number qd, number voltage) {
  const Motor motor = motor_now(drive, supplied, control);
  const Currents currents = currents_within(drive, motor, desired_torque(drive, motor, control, q, qd), qd, voltage * S(PHASE_SHARE));
  return shaft_torque(drive, motor, currents.torque) * qd + S(1.5) * motor.resistance * squared_current(motor, currents);
}
// What all motors would draw at a bus voltage
FUNCTION number drawn_at(const Robot& robot, Place place, number voltage) {
  number drawn[LEGS_HERE];
  UNROLL for (int i = 0; i < LEGS_HERE; i++) {
    const Leg& leg = robot.legs[i];
    drawn[i] = splat(S(0));
    UNROLL for (int k = 0; k < DRIVES; k++)
      drawn[i] = drawn[i] + drawn_by(leg_drive(k, leg.constants), robot.supplied, leg.joints[k].control, leg.q[DRIVE_LINK[k]], leg.qd[DRIVE_LINK[k]], voltage);
  }
#ifdef WAIST
  return over_legs(drawn) + drawn_by(waist_drive(), robot.supplied, robot.joint.control, robot.q[0], robot.qd[0], voltage);
#else
  return over_legs(drawn);
#endif
}
#endif

FUNCTION void aim(Control& control, number delay, int index) {  // targets change when the delay is over
  control.now = if_greater(delay, splat(S(index)), control.previous, control.target);
}
FUNCTION void turn_motor_loop(Robot& robot, Place place, int index) {  // once in BIN substeps
  UNROLL for (int i = 0; i < LEGS_HERE; i++)
    UNROLL for (int k = 0; k < DRIVES; k++) aim(robot.legs[i].joints[k].control, robot.delay, index);
#ifdef WAIST
  aim(robot.joint.control, robot.delay, index);
#endif
#ifdef BATTERY
  robot.pack.voltage = shared_voltage(robot.pack, [&](number voltage) { return drawn_at(robot, place, voltage); });
  robot.supplied.voltage = robot.pack.voltage * S(PHASE_SHARE);
  discharge(robot.pack, drawn_at(robot, place, robot.pack.voltage));
#endif
  UNROLL for (int i = 0; i < LEGS_HERE; i++)
    UNROLL for (int k = 0; k < DRIVES; k++) {
      Leg& leg = robot.legs[i];
      Joint& joint = leg.joints[k];
      joint.driven = drive_joint(leg_drive(k, leg.constants), robot.supplied, joint.control, leg.q[DRIVE_LINK[k]], leg.qd[DRIVE_LINK[k]]);
    }
#ifdef WAIST
  robot.joint.driven = drive_joint(waist_drive(), robot.supplied, robot.joint.control, robot.q[0], robot.qd[0]);
#endif
}

FUNCTION number torque_of(Joint& joint, const Drive& drive, const Supplied& supplied, number q, number qd) {
  number depth;
  joint.control.temperature = warmed(joint.control.temperature, joint.driven.loss);
  const number torque = joint.driven.delivered + passive_torque(drive, supplied, q, qd, depth);
  joint.watch.depth = larger(joint.watch.depth, depth);
  return torque;
}

// Each millisecond: what one motor feeds back another one uses, but a surplus of all is lost, as in the audit
FUNCTION void end_window(Robot& robot, Place place) {
  number drawn[LEGS_HERE];
  UNROLL for (int i = 0; i < LEGS_HERE; i++) {
    end_foot_window(robot.legs[i].watch);
    drawn[i] = splat(S(0));
    UNROLL for (int k = 0; k < DRIVES; k++) drawn[i] = drawn[i] + end_joint_window(robot.legs[i].joints[k].watch);
  }
  number bus = over_legs(drawn);
#ifdef WAIST
  bus = bus + end_joint_window(robot.joint.watch);
#endif
  robot.power = robot.power + larger(bus, splat(S(0)));
}

FUNCTION void substep(const Buffers& buffers, Place place, int index, Robot& robot, number* acceleration) {
  const number step = robot.step, half = step * S(0.5);
  const bool first = index % BIN == 0;
  number m[9], parts[LEGS_HERE][27], sum[27], start[6];
  if (first) turn_motor_loop(robot, place, index);
  rotation(robot.trunk.quaternion, m);
  const Carrier front = carrier_of(robot.trunk, robot.mass, m), rear = rear_carrier(front, robot);
  sense(robot, front, rear, place);
  if (index % DISTANCE_PERIOD == 0) watch_distances(robot, place);
  UNROLL for (int i = 0; i < LEGS_HERE; i++) {
    const int l = leg_number(i, place);
    Leg& leg = robot.legs[i];
    UNROLL for (int k = 0; k < DRIVES; k++) {
      const int link = DRIVE_LINK[k];
      leg.tau[link] = torque_of(leg.joints[k], leg_drive(k, leg.constants), robot.supplied, leg.q[link], leg.qd[link]);
    }
#ifdef GIVEN_TORQUE
    UNROLL for (int k = 0; k < LINKS; k++) leg.tau[k] = read(buffers.given_torque, NV, QVEL[l * LINKS + k], place);
#endif
    leg.touch = press(robot.pad, S(FOOT_RADIUS) - leg.foot[0], leg.foot + 1, leg.bristle, step);
    leg_backward(carrier_of_leg(front, rear, l), leg.q, leg.qd, leg.tau, leg.constants, half, leg.touch.force, leg.touch.damping,
                 leg.touch.drag, leg.kept, parts[i]);
  }
#ifdef WAIST
  number rear_sum[27], through[27], qdd_waist[1], rear_start[6];
  sum_pairs(parts, sum, rear_sum, place);
  robot.tau[0] = torque_of(robot.joint, waist_drive(), robot.supplied, robot.q[0], robot.qd[0]);
#ifdef GIVEN_TORQUE
  robot.tau[0] = read(buffers.given_torque, NV, WAIST_QVEL, place);
#endif
  waist_backward(front, robot.q, robot.qd, robot.tau, half, rear_sum, robot.kept, through);
  UNROLL for (int i = 0; i < 27; i++) sum[i] = sum[i] + through[i];
#else
  sum_legs(parts, sum);
#endif
  add_body(front, robot.mass.mass, robot.mass.lever, robot.mass.inertia, sum);
  add_air(front, robot.mass, sum);
  trunk_solve(sum, start);
#ifdef WAIST
  waist_accelerate(start, rear_sum, robot.kept, qdd_waist, rear_start);
#endif
  UNROLL for (int i = 0; i < LEGS_HERE; i++) {
    const int l = leg_number(i, place);
    Leg& leg = robot.legs[i];
    number qdd[LINKS], contact[3], from[6];
    UNROLL for (int k = 0; k < 6; k++) {
#ifdef WAIST
      from[k] = l < REAR_LEG ? start[k] : rear_start[k];
#else
      from[k] = start[k];
#endif
    }
    leg_accelerate(carrier_of_leg(front, rear, l), from, leg.constants, leg.kept, qdd, contact);
    settle(leg.touch, robot.pad, leg.foot + 1, contact, step, leg.bristle);
    UNROLL for (int k = 0; k < DRIVES; k++)
      watch_joint(leg.joints[k].watch, leg_drive(k, leg.constants), leg.joints[k].driven, leg.qd[DRIVE_LINK[k]], qdd[DRIVE_LINK[k]], step, first);
    watch_foot(leg.watch, leg.touch.force[2], leg.touch.depth, step, robot.stride, robot.stance, first);
    UNROLL for (int k = 0; k < LINKS; k++) {
#ifdef GIVEN_TORQUE
      write(buffers.qacc, NV, QVEL[l * LINKS + k], qdd[k], place);
#endif
      leg.qd[k] = leg.qd[k] + step * qdd[k];
      leg.q[k] = leg.q[k] + step * leg.qd[k];
    }
  }
#ifdef WAIST
  watch_joint(robot.joint.watch, waist_drive(), robot.joint.driven, robot.qd[0], qdd_waist[0], step, first);
#ifdef GIVEN_TORQUE
  if (first_leg(place)) write(buffers.qacc, NV, WAIST_QVEL, qdd_waist[0], place);
#endif
  robot.qd[0] = robot.qd[0] + step * qdd_waist[0];
  robot.q[0] = robot.q[0] + step * robot.qd[0];
#endif
  if (index % BIN == BIN - 1) end_window(robot, place);
  world_acceleration(robot.mass, m, start + 3, acceleration);
  UNROLL for (int i = 0; i < 3; i++) acceleration[3 + i] = start[i];
  move_trunk(robot.trunk, acceleration, acceleration + 3, step);
}

FUNCTION void policy_step(const Buffers& buffers, Place place) {
  Robot robot;
  number m[9], acceleration[6];
  read_robot(buffers, place, robot);
  UNROLL for (int i = 0; i < LEGS_HERE; i++) read_leg(buffers, place, leg_number(i, place), robot.legs[i]);
#pragma unroll 1
  for (int index = 0; index < SUBSTEPS; index++) substep(buffers, place, index, robot, acceleration);
  normalize(robot.trunk.quaternion);
  rotation(robot.trunk.quaternion, m);
  const Carrier front = carrier_of(robot.trunk, robot.mass, m), rear = rear_carrier(front, robot);
  sense(robot, front, rear, place);
  watch_distances(robot, place);
  write_distances(buffers, place, robot);
  UNROLL for (int i = 0; i < LEGS_HERE; i++) write_leg(buffers, place, leg_number(i, place), robot.legs[i], robot.trunk, m);
  write_robot(buffers, place, robot, acceleration);
}
