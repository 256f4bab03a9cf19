// One log of the replay: columns at even times.

class Run {
  constructor(given) {
    Object.assign(this, given);
    this.columns = Object.fromEntries(Object.entries(given.columns).map(([name, column]) => [name, unpacked(column)]));
    this.duration = this.interval * (this.rows - 1);
    this.start = 0;  // time of the first row
  }

  has(name) {
    return name in this.columns;
  }

  /** Return the row before a time, and how far it is to the next one (0 to 1). */
  place(time) {
    const row = Math.min(Math.max(time / this.interval, 0), this.rows - 1);
    const before = Math.min(Math.floor(row), Math.max(this.rows - 2, 0));
    return [before, Math.min(row - before, this.rows - 1)];
  }

  /** Return a column's value at a time, on the line between two rows. */
  value(name, time) {
    const values = this.columns[name];
    const [row, share] = this.place(time);
    return share === 0 ? values[row] : values[row] * (1 - share) + values[row + 1] * share;
  }

  /** Return the value that holds at a time: the one of the row before. */
  held(name, time) {
    const [row, share] = this.place(time);
    return this.columns[name][share < 1 ? row : row + 1];
  }

  /** Return a signal's value at a time: of a band the middle. */
  reading(signal, time) {
    const [first, second] = signal.columns;
    return second ? (this.held(first, time) + this.held(second, time)) / 2 : this.value(first, time);
  }

  values(names, time) {
    return names.map((name) => this.value(name, time));
  }

  /** Return whether a time is past the end of the log. */
  ended(time) {
    return time > this.duration + 1e-6;
  }

  /** Return the matrices of ball, body and wheels at a time. */
  pose(time) {
    const [x, y, theta, phi, psi] = this.values(["x", "y", "theta", "phi", "psi"], time);
    const center = [x, y, this.robot.ball_radius];
    const body = attitude(theta, phi, psi, center);
    const wheels = this.robot.wheels.map((wheel, i) => {
      const { contact, rolling, axle } = wheel;
      // x to the contact, y along the rolling direction; the wheel turns about -a_i
      const fixed = frame(scale(contact, -1), rolling, scale(axle, -1), wheel.center);
      return multiply(body, multiply(fixed, aboutZ(this.value(`wheel${i + 1}`, time))));
    });
    return { center, body, wheels, ball: ofQuaternion(this.values(["ball_w", "ball_x", "ball_y", "ball_z"], time), center) };
  }

  /** Return the points of the path over the floor, and of its reference where the log has one. */
  path(x, y) {
    return Array.from(this.columns[x], (value, row) => [value, this.columns[y][row], 0]);
  }

  /** Return the least and the greatest value of columns. */
  range(names) {
    let [least, greatest] = [Infinity, -Infinity];
    for (const name of names)
      for (const value of this.columns[name]) {
        if (value < least) least = value;
        if (value > greatest) greatest = value;
      }
    return [least, greatest];
  }
}
