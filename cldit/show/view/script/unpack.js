// Arrays as cldit/show/view/packing.py writes them: base64 of deflated bytes.

async function inflated(text) {
  const letters = atob(text);
  const bytes = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) bytes[i] = letters.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

// Four planes of bytes hold differences of the numbers' bits, folded so that small ones are small
// whatever their sign.
function unfolded(planes, count) {
  const bytes = new Uint8Array(planes);
  const word = new Int32Array(count);
  let last = 0;
  for (let i = 0; i < count; i++) {
    const folded = bytes[i] | (bytes[count + i] << 8) | (bytes[2 * count + i] << 16)
      | (bytes[3 * count + i] << 24);
    last = (last + ((folded >>> 1) ^ -(folded & 1))) | 0;
    word[i] = last;
  }
  return new Float32Array(word.buffer);
}

async function unpacked(head, text) {
  const buffer = await inflated(text);
  if (head.dtype === "float32") return unfolded(buffer, head.count);
  const kinds = { float64: Float64Array, uint8: Uint8Array, uint16: Uint16Array };
  return new kinds[head.dtype](buffer);
}
