// Columns as few bytes of text, packed by Python (`ballbot.viewer.packing`).

const MISSING = 65535;

/** Return the numbers of a packed column: whole numbers of 16 bits with an offset and a step, or of 32 bits as they are. */
function unpacked(column) {
  const text = atob(column.data);
  const bytes = Uint8Array.from(text, (letter) => letter.charCodeAt(0));
  if (column.kind === "float32") return new Float32Array(bytes.buffer);
  const whole = new Uint16Array(bytes.buffer);
  return Float32Array.from(whole, (k) => (k === MISSING ? NaN : column.offset + column.step * k));
}
