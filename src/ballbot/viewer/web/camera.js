// The camera that turns about a target: drag to orbit, two fingers or the right button to shift, wheel or pinch to zoom.

class Camera {
  constructor() {
    this.fieldOfView = 0.6;
    this.azimuth = -1.05;
    this.elevation = 0.42;
    this.distance = 3;
    this.target = [0, 0, 0.3];
  }

  eye() {
    const flat = Math.cos(this.elevation);
    const out = [flat * Math.cos(this.azimuth), flat * Math.sin(this.azimuth), Math.sin(this.elevation)];
    return add(this.target, scale(out, this.distance));
  }

  /** See a box from one corner to the other whole, in a picture of that width over height. */
  fit(low, high, aspect) {
    this.target = scale(add(low, high), 0.5);
    const [right, up, back] = this.axes();
    const slope = Math.tan(this.fieldOfView / 2);
    this.distance = 0;
    for (let corner = 0; corner < 8; corner++) {
      const point = [0, 1, 2].map((axis) => ((corner >> axis) & 1 ? high : low)[axis]);
      const from = subtract(point, this.target);
      const size = Math.max(Math.abs(dot(from, right)) / aspect, Math.abs(dot(from, up)));
      this.distance = Math.max(this.distance, dot(from, back) + (1.15 * size) / slope);
    }
  }

  orbit(dx, dy) {
    this.azimuth -= 0.008 * dx;
    this.elevation = Math.min(Math.max(this.elevation + 0.008 * dy, 0.03), 1.54);
  }

  zoom(factor) {
    this.distance = Math.min(Math.max(this.distance * factor, 0.2), 200);
  }

  /** Shift the target along the picture by pixels of a picture of that height. */
  shift(dx, dy, height) {
    const size = (2 * this.distance * Math.tan(this.fieldOfView / 2)) / height;
    const [right, up] = this.axes();
    this.target = add(this.target, add(scale(right, -dx * size), scale(up, dy * size)));
  }

  /** Return the axes of the picture: to the right, up, and towards the eye. */
  axes() {
    const back = unit(subtract(this.eye(), this.target));
    const right = unit(cross([0, 0, 1], back));
    return [right, cross(back, right), back];
  }

  /** Return the direction from the eye through a pixel of a picture. */
  ray([x, y], [width, height]) {
    const [right, up, back] = this.axes();
    const slope = Math.tan(this.fieldOfView / 2);
    const aside = add(scale(right, ((2 * x) / width - 1) * slope * (width / height)), scale(up, (1 - (2 * y) / height) * slope));
    return unit(subtract(aside, back));
  }

  /** Return the distance of the floor's lines [m]: 1, 2 or 5 times a power of ten. */
  gridSpacing() {
    return niceStep(this.distance / 25);
  }
}

/** Return 1, 2 or 5 times a power of ten, the next one at or above a number. */
function niceStep(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return power * [1, 2, 5, 10].find((digit) => digit * power >= least * 0.999);
}

/** Let a camera follow the pointer on an element; `changed` is called after each move. Within a longer page, vertical
 * swipes and the wheel scroll it, and the wheel zooms with Ctrl. */
function controlCamera(camera, element, changed) {
  const whole = getComputedStyle(element).touchAction === "none";
  const fingers = new Map();
  const spread = () => {
    const [a, b] = [...fingers.values()];
    return { size: Math.hypot(a[0] - b[0], a[1] - b[1]) || 1, middle: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2] };
  };
  element.addEventListener("pointerdown", (event) => {
    element.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  element.addEventListener("pointermove", (event) => {
    const last = fingers.get(event.pointerId);
    if (!last) return;
    const before = fingers.size === 2 ? spread() : null;
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    const [dx, dy] = [event.clientX - last[0], event.clientY - last[1]];
    if (before) {
      const after = spread();
      camera.zoom(before.size / after.size);
      camera.shift(after.middle[0] - before.middle[0], after.middle[1] - before.middle[1], element.clientHeight);
    } else if (event.buttons & 2 || event.shiftKey) camera.shift(dx, dy, element.clientHeight);
    else camera.orbit(dx, dy);
    changed();
  });
  for (const end of ["pointerup", "pointercancel"]) element.addEventListener(end, (event) => fingers.delete(event.pointerId));
  element.addEventListener("contextmenu", (event) => event.preventDefault());
  element.addEventListener("wheel", (event) => {
    if (!whole && !event.ctrlKey) return;
    event.preventDefault();
    camera.zoom(Math.exp(0.0012 * event.deltaY));
    changed();
  }, { passive: false });
}
