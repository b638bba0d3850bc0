// Setpoints as the pendant sends them: samples, joints, period in s, then 32-bit floats, sample by sample; see queries.py.
const HEAD_BYTES = 16;

export function readSetpoints(buffer) {
  const head = new DataView(buffer);
  const samples = buffer.byteLength < HEAD_BYTES ? 0 : head.getUint32(0, true);
  const joints = samples ? head.getUint32(4, true) : 0;
  const period = samples ? head.getFloat64(8, true) : 0;
  const q = samples ? new Float32Array(buffer, HEAD_BYTES) : null;
  return { samples, joints, period, sample: (k) => q.subarray(k * joints, (k + 1) * joints) };
}
