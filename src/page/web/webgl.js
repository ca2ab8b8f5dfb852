// Draws the figure with WebGL 2 through OGL: every shape is an instance of one square that turns to the camera.

const SQUARE = [-1, -1, 1, -1, -1, 1, 1, 1];

const POINT_SHADER = `#version 300 es
in vec2 corner; in vec4 place; in vec4 colour;
uniform mat4 viewMatrix, projectionMatrix; uniform vec2 size; uniform float dpr;
out vec2 at; out vec4 tint; out float edge;
void main() {
  vec4 clip = projectionMatrix * viewMatrix * vec4(place.xyz, 1.0);
  float pixels = place.w * dpr + 2.0;
  at = corner * pixels * 0.5; edge = place.w * dpr * 0.5; tint = colour;
  clip.xy += corner * pixels / size * clip.w;
  clip.z -= 0.0005 * clip.w;
  gl_Position = clip;
}`;

const POINT_COLOUR = `#version 300 es
precision highp float;
in vec2 at; in vec4 tint; in float edge; out vec4 result;
void main() {
  float cover = clamp(edge - length(at) + 0.5, 0.0, 1.0);
  if (cover <= 0.0) discard;
  float a = tint.a * cover;
  result = vec4(tint.rgb * a, a);
}`;

const LINE_SHADER = `#version 300 es
in vec2 corner; in vec3 from; in vec3 to; in float thick; in vec4 colour;
uniform mat4 viewMatrix, projectionMatrix; uniform vec2 size; uniform float dpr;
out float across; out float half_; out vec4 tint; out vec3 ground;
void main() {
  vec4 a = viewMatrix * vec4(from, 1.0), b = viewMatrix * vec4(to, 1.0);
  float near = -0.02;
  vec4 a1 = a.z > near ? mix(a, b, (near - a.z) / (b.z - a.z)) : a;
  vec4 b1 = b.z > near ? mix(b, a, (near - b.z) / (a.z - b.z)) : b;
  vec4 p = projectionMatrix * a1, q = projectionMatrix * b1;
  vec2 along = (q.xy / q.w - p.xy / p.w) * size;
  along = length(along) > 0.0 ? normalize(along) : vec2(1.0, 0.0);
  vec4 clip = corner.x < 0.0 ? p : q;
  float pixels = thick * dpr + 2.0;
  across = corner.y * pixels * 0.5; half_ = thick * dpr * 0.5; tint = colour;
  ground = corner.x < 0.0 ? from : to;
  clip.xy += vec2(-along.y, along.x) * corner.y * pixels / size * clip.w;
  gl_Position = clip;
}`;

const LINE_COLOUR = `#version 300 es
precision highp float;
in float across; in float half_; in vec4 tint; in vec3 ground; out vec4 result;
uniform vec3 middle; uniform float reach;
void main() {
  float cover = clamp(half_ - abs(across) + 0.5, 0.0, 1.0);
  if (reach > 0.0) cover *= smoothstep(reach, reach * 0.2, distance(ground.xz, middle.xz));
  if (cover <= 0.0) discard;
  float a = tint.a * cover;
  result = vec4(tint.rgb * a, a);
}`;

const BALL_SHADER = `#version 300 es
in vec2 corner; in vec4 place; in vec4 colour;
uniform mat4 viewMatrix, projectionMatrix;
out vec2 at; out vec4 tint;
void main() {
  vec4 view = viewMatrix * vec4(place.xyz, 1.0);
  view.xy += corner * place.w;
  at = corner; tint = colour;
  gl_Position = projectionMatrix * view;
}`;

const BALL_COLOUR = `#version 300 es
precision highp float;
in vec2 at; in vec4 tint; out vec4 result;
void main() {
  float r = length(at);
  if (r > 1.0) discard;
  float soft = 1.0 - smoothstep(1.0 - fwidth(r) * 1.5, 1.0, r);
  float a = tint.a * (0.55 + 0.9 * r * r * r) * soft;
  result = vec4(tint.rgb * a, a);
}`;

/** A renderer, or null where there is no WebGL 2. */
function webgl(canvas, figure) {
  const attributes = { alpha: true, antialias: true, depth: true, premultipliedAlpha: true, preserveDrawingBuffer: false };
  let context = null;
  try {
    context = canvas.getContext("webgl2", attributes);
  } catch {
    // some browsers throw where others give null
  }
  if (!context) return null;
  const renderer = new ogl.Renderer({ canvas, dpr: Math.min(2, window.devicePixelRatio || 1), ...attributes });
  const gl = renderer.gl;
  gl.clearColor(0, 0, 0, 0);
  const shared = { size: { value: [1, 1] }, dpr: { value: renderer.dpr }, middle: { value: [0, 0, 0] } };

  function layer(vertex, fragment, shapes, parts, options = {}) {
    const most = Math.max(1, shapes.data.length / shapes.size);
    const attributes = { corner: { size: 2, data: new Float32Array(SQUARE) } };
    let offset = 0;
    for (const [name, size] of parts) {
      attributes[name] = { size, instanced: 1, data: new Float32Array(size * most), usage: gl.DYNAMIC_DRAW, from: offset };
      offset += size;
    }
    const geometry = new ogl.Geometry(gl, attributes);
    const program = new ogl.Program(gl, {
      vertex,
      fragment,
      transparent: true,
      cullFace: false,
      depthWrite: options.depthWrite ?? false,
      uniforms: { ...shared, reach: { value: options.reach || 0 } },
    });
    const mesh = new ogl.Mesh(gl, { geometry, program, mode: gl.TRIANGLE_STRIP, frustumCulled: false });
    return {
      mesh,
      send() {
        for (const [name, size] of parts) {
          const { data, from } = attributes[name];
          for (let k = 0; k < shapes.count; k++) {
            for (let c = 0; c < size; c++) data[k * size + c] = shapes.data[k * shapes.size + from + c];
          }
          attributes[name].needsUpdate = true;
        }
        geometry.setInstancedCount(shapes.count);
        mesh.visible = shapes.count > 0;
      },
    };
  }

  const floor = new Shapes(LINE, 80);
  const lineParts = [["from", 3], ["to", 3], ["thick", 1], ["colour", 4]];
  const pointParts = [["place", 4], ["colour", 4]];
  const layers = [
    layer(LINE_SHADER, LINE_COLOUR, floor, lineParts, { reach: 4 }),
    layer(LINE_SHADER, LINE_COLOUR, figure.lines, lineParts),
    layer(POINT_SHADER, POINT_COLOUR, figure.points, pointParts, { depthWrite: true }),
    layer(BALL_SHADER, BALL_COLOUR, figure.balls, pointParts),
  ];
  const scene = new ogl.Transform();
  layers.forEach(({ mesh }, order) => {
    mesh.renderOrder = order;
    mesh.setParent(scene);
  });

  return {
    kind: "webgl",
    canvas,
    resize(width, height) {
      renderer.setSize(width, height);
      shared.size.value = [width * renderer.dpr, height * renderer.dpr];
    },
    draw(view, show) {
      floor.count = 0;
      if (show.floor) {
        for (const [x0, y, z0, x1, , z1, strong] of figure.floorLines(view.target)) floor.add(x0, y, z0, x1, y, z1, strong ? 1.4 : 1, ...figure.palette.grid, strong ? 0.9 : 0.55);
      }
      shared.middle.value = [...view.target];
      for (const one of layers) one.send();
      renderer.render({ scene, camera: view.camera, sort: false, frustumCull: false });
    },
  };
}
