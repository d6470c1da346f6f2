"use strict";
// Gaussian splats in WebGL 2, after Kerbl et al. 2023: each Gaussian is drawn as the ellipse that its projection is
// (EWA, Zwicker et al. 2001), back to front. Axes of cameras are OpenCV's: x right, y down, z forward.
const splats = (() => {
  // ------------------------------------------------------------ from the file
  // What report/splats.py packed: bytes in planes, one value of all splats after the other.
  async function unpack(packed) {
    const zipped = Uint8Array.from(atob(packed.gzip), letter => letter.charCodeAt(0));
    const stream = new Blob([zipped]).stream().pipeThrough(new DecompressionStream("gzip"));
    const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
    const n = packed.n;
    const plane = k => bytes.subarray(k * n, (k + 1) * n);
    const [low, high, logs, turns] = [0, 3, 6, 9].map(first => [0, 1, 2, 3].map(k => plane(first + k)));
    const [least, most] = packed.log_scales;
    const means = new Float32Array(3 * n), scales = new Float32Array(3 * n), axes = new Float32Array(9 * n);
    const rgba = new Uint8Array(4 * n), owners = new Uint16Array(n);
    for (let i = 0; i < n; i++) {
      for (let k = 0; k < 3; k++) {
        means[3 * i + k] = packed.low[k] + (low[k][i] + 256 * high[k][i]) / 65535 * packed.widths[k];
        scales[3 * i + k] = Math.exp(least + logs[k][i] / 255 * (most - least));
      }
      axes.set(rotation(turns.map(turn => turn[i] - 127)), 9 * i);
      for (let k = 0; k < 4; k++) rgba[4 * i + k] = plane(13 + k)[i];
      owners[i] = plane(17)[i] + 256 * plane(18)[i];
    }
    return { n, means, scales, axes, rgba, owners };
  }

  // Row after row, the matrix of a quaternion wxyz of any length.
  function rotation(quaternion) {
    const [w, x, y, z] = quaternion.map(part => part / Math.hypot(...quaternion));
    return [
      1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
      2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
      2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ];
  }

  // The six different entries of a Gaussian's covariance, R S S' R'.
  function covariance({ axes, scales }, i) {
    const entry = (row, column) => [0, 1, 2].reduce((sum, k) =>
      sum + axes[9 * i + 3 * row + k] * axes[9 * i + 3 * column + k] * scales[3 * i + k] ** 2, 0);
    return [entry(0, 0), entry(0, 1), entry(0, 2), entry(1, 1), entry(1, 2), entry(2, 2)];
  }

  // ------------------------------------------------------------ drawing
  const VERTEX = `#version 300 es
    precision highp float;
    uniform highp sampler2D shapes;
    uniform sampler2D colours;
    uniform mat3 turn;
    uniform vec3 eye;
    uniform vec2 screen;
    uniform float focal;
    layout(location = 0) in vec2 corner;
    layout(location = 1) in uint splat;
    out vec2 offset;
    out vec4 colour;

    const float REACH = 2.83;      // standard deviations that are drawn: to exp(-4)
    const float PIXEL = 0.15;      // variance that drawing in pixels adds, px^2
    void main() {
      ivec2 at = ivec2(int(splat % 1024u) * 3, int(splat / 1024u));
      vec4 a = texelFetch(shapes, at, 0), b = texelFetch(shapes, at + ivec2(1, 0), 0), c = texelFetch(shapes, at + ivec2(2, 0), 0);
      vec3 seen = turn * (a.xyz - eye);
      gl_Position = vec4(0.0, 0.0, 2.0, 1.0);
      if (seen.z < 0.02 * length(eye - a.xyz) || seen.z <= 0.0) return;
      mat3 spread = turn * mat3(a.w, b.x, b.y, b.x, b.z, b.w, b.y, b.w, c.x) * transpose(turn);
      vec2 bound = 0.65 * screen / focal;
      vec2 slope = clamp(seen.xy / seen.z, -bound, bound);
      mat3 jacobian = mat3(focal / seen.z, 0.0, 0.0, 0.0, focal / seen.z, 0.0, -focal * slope.x / seen.z, -focal * slope.y / seen.z, 0.0);
      mat3 flat3 = jacobian * spread * transpose(jacobian);
      float sharp = max(flat3[0][0] * flat3[1][1] - flat3[0][1] * flat3[0][1], 0.0);
      float xx = flat3[0][0] + PIXEL, yy = flat3[1][1] + PIXEL, xy = flat3[0][1];
      float middle = 0.5 * (xx + yy), radius = length(vec2(0.5 * (xx - yy), xy));
      float large = middle + radius, small = max(middle - radius, PIXEL);
      vec2 direction = abs(xy) > 1e-9 ? normalize(vec2(xy, large - xx)) : (xx >= yy ? vec2(1.0, 0.0) : vec2(0.0, 1.0));
      vec2 place = seen.xy / seen.z * focal
        + REACH * (corner.x * sqrt(large) * direction + corner.y * sqrt(small) * vec2(-direction.y, direction.x));
      gl_Position = vec4(place.x / (0.5 * screen.x), -place.y / (0.5 * screen.y), 0.0, 1.0);
      offset = REACH * corner;
      colour = texelFetch(colours, ivec2(splat % 1024u, splat / 1024u), 0);
      colour.a *= sqrt(sharp / (large * small));  // what a pixel widens it must not make it denser
    }`;
  const FRAGMENT = `#version 300 es
    precision highp float;
    in vec2 offset;
    in vec4 colour;
    out vec4 pixel;
    void main() {
      float alpha = min(colour.a * exp(-0.5 * dot(offset, offset)), 0.99);
      if (alpha < 1.0 / 255.0) discard;
      pixel = vec4(colour.rgb * alpha, alpha);
    }`;

  function compile(gl) {
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) || "no program");
    return program;
  }

  function texture(gl, unit) {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.NEAREST);
  }

  // Rows of splats, farthest first, by counting into 65536 depths.
  function sorter(cloud) {
    const { n, means } = cloud;
    const depths = new Float32Array(n), keys = new Uint16Array(n), order = new Uint32Array(n);
    const starts = new Uint32Array(65537);
    return forward => {
      let [near, far] = [Infinity, -Infinity];
      for (let i = 0; i < n; i++) {
        const depth = means[3 * i] * forward[0] + means[3 * i + 1] * forward[1] + means[3 * i + 2] * forward[2];
        depths[i] = depth;
        near = Math.min(near, depth);
        far = Math.max(far, depth);
      }
      starts.fill(0);
      for (let i = 0; i < n; i++) {
        keys[i] = 65535 * (far - depths[i]) / (far - near || 1);
        starts[keys[i] + 1]++;
      }
      for (let k = 0; k < 65536; k++) starts[k + 1] += starts[k];
      for (let i = 0; i < n; i++) order[starts[keys[i]]++] = i;
      return order;
    };
  }

  // Draws a cloud into a canvas; throws where WebGL 2 is missing.
  function renderer(canvas, cloud) {
    const gl = canvas.getContext("webgl2", { alpha: true, antialias: false, depth: false, preserveDrawingBuffer: true });
    const sort = sorter(cloud);
    const rows = Math.ceil(cloud.n / 1024);
    let uniform;

    function prepare() {
      const program = compile(gl);
      gl.useProgram(program);
      uniform = name => gl.getUniformLocation(program, name);
      const shapes = new Float32Array(1024 * 3 * rows * 4);
      for (let i = 0; i < cloud.n; i++) {
        shapes.set([...cloud.means.subarray(3 * i, 3 * i + 3), ...covariance(cloud, i)], 12 * i);
      }
      texture(gl, 0);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, 1024 * 3, rows, 0, gl.RGBA, gl.FLOAT, shapes);
      texture(gl, 1);
      paint(cloud.rgba);
      gl.uniform1i(uniform("shapes"), 0);
      gl.uniform1i(uniform("colours"), 1);
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]), gl.STATIC_DRAW);
      gl.enableVertexAttribArray(0);
      gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, 4 * cloud.n, gl.DYNAMIC_DRAW);
      gl.enableVertexAttribArray(1);
      gl.vertexAttribIPointer(1, 1, gl.UNSIGNED_INT, 0, 0);
      gl.vertexAttribDivisor(1, 1);
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    }

    // Colours and opacities, four bytes a splat.
    function paint(rgba) {
      const filled = new Uint8Array(1024 * rows * 4);
      filled.set(rgba);
      gl.activeTexture(gl.TEXTURE1);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 1024, rows, 0, gl.RGBA, gl.UNSIGNED_BYTE, filled);
    }

    // One view: axes (rows right, down, forward), eye, focal length in px of a canvas of width x height.
    function draw({ axes, eye, focal, width, height }, ratio) {
      const size = [Math.round(width * ratio), Math.round(height * ratio)];
      if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
      gl.viewport(0, 0, ...size);
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT);
      gl.uniformMatrix3fv(uniform("turn"), true, axes.flat());
      gl.uniform3fv(uniform("eye"), eye);
      gl.uniform2fv(uniform("screen"), size);
      gl.uniform1f(uniform("focal"), focal * ratio);
      gl.bufferSubData(gl.ARRAY_BUFFER, 0, sort(axes[2]));
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, cloud.n);
    }

    canvas.addEventListener("webglcontextlost", event => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", prepare);
    prepare();
    return { draw, paint };
  }

  // ------------------------------------------------------------ pointing
  // Where a ray has met half of what it can meet: each Gaussian counts at its densest point of the ray.
  function touch(cloud, eye, ray) {
    const met = [];
    const { means, scales, axes, rgba } = cloud;
    for (let i = 0; i < cloud.n; i++) {
      let along = 0, square = 0, missed = 0;
      for (let k = 0; k < 3; k++) {
        let [away, step] = [0, 0];
        for (let j = 0; j < 3; j++) {
          away += axes[9 * i + 3 * j + k] * (means[3 * i + j] - eye[j]);
          step += axes[9 * i + 3 * j + k] * ray[j];
        }
        away /= scales[3 * i + k];
        step /= scales[3 * i + k];
        along += away * step;
        square += step * step;
        missed += away * away;
      }
      const far = along / square;
      const alpha = rgba[4 * i + 3] / 255 * Math.exp(-0.5 * (missed - far * along));
      if (far > 0 && alpha > 0.02) met.push({ far, alpha });
    }
    let left = 1;
    for (const { far, alpha } of met.sort((a, b) => a.far - b.far)) {
      left *= 1 - alpha;
      if (left < 0.5) return eye.map((x, k) => x + far * ray[k]);
    }
    return undefined;
  }

  return { unpack, renderer, touch };
})();
