// Undoes what `src/page/pack.rs` does: base 64, zlib, integers of variable length.

/** The bytes of one of the document's data blocks. */
async function inflate(id) {
  const text = atob(document.getElementById(id).textContent.trim());
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Reads numbers of variable length, 0, -1, 1, -2, ... being 0, 1, 2, 3, ... */
function reader(bytes) {
  let at = 0;
  return {
    get more() {
      return at < bytes.length;
    },
    next() {
      let value = 0, scale = 1, byte;
      do {
        byte = bytes[at++];
        value += (byte & 0x7f) * scale;
        scale *= 128;
      } while (byte & 0x80);
      return value % 2 ? -(value + 1) / 2 : value / 2;
    },
  };
}

