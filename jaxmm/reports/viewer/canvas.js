// WebGL in four words: a context, programs, buffers and how a program reads them.

/** The context, or null where the browser has none. What was drawn is kept, for printing. */
function contextOf(canvas) {
  return canvas.getContext("webgl2", { antialias: true, alpha: false, preserveDrawingBuffer: true });
}

/** A linked program with the places of its uniforms by name. */
function linked(gl, [vertex, fragment]) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    const logs = gl.getAttachedShaders(program).map((shader) => gl.getShaderInfoLog(shader));
    throw new Error(`a shader does not compile: ${logs.join(" ")} ${gl.getProgramInfoLog(program)}`);
  }
  const at = {};
  const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS);
  for (let i = 0; i < count; i++) {
    const { name } = gl.getActiveUniform(program, i);
    at[name.replace("[0]", "")] = gl.getUniformLocation(program, name);
  }
  return { program, at };
}

function filled(gl, values) {
  const buffer = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
  return buffer;
}

/** A texture of lines as `lineBytes` gives them, LINES_A_ROW in a row. */
function lineTexture(gl, bytes) {
  const texture = gl.createTexture();
  const rows = Math.max(1, Math.ceil(bytes.length / (LINE * LINES_A_ROW)));
  const whole = new Uint32Array(rows * LINE * LINES_A_ROW);
  whole.set(bytes);
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texImage2D(
    gl.TEXTURE_2D, 0, gl.RGBA32UI, 2 * LINES_A_ROW, rows, 0, gl.RGBA_INTEGER, gl.UNSIGNED_INT, whole,
  );
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  return texture;
}

/** How a program reads its attributes: rows of {name, buffer, size, kind, normalized, stride}. */
function readBy(gl, { program }, rows) {
  const reader = gl.createVertexArray();
  gl.bindVertexArray(reader);
  for (const row of rows) {
    const place = gl.getAttribLocation(program, row.name);
    gl.bindBuffer(gl.ARRAY_BUFFER, row.buffer);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, row.size, row.kind, row.normalized ?? false, row.stride ?? 0, 0);
  }
  gl.bindVertexArray(null);
  return reader;
}

/**
 * Let the canvas have as many pixels as the screen shows of it, at most two a CSS pixel, or a share of them; returns
 * that ratio.
 */
function fitted(canvas, share) {
  const ratio = Math.min(window.devicePixelRatio || 1, 2) * share;
  const pixels = (size) => Math.max(1, Math.round(size * ratio));
  const [width, height] = [canvas.clientWidth, canvas.clientHeight].map(pixels);
  if (canvas.width !== width) canvas.width = width;
  if (canvas.height !== height) canvas.height = height;
  return ratio;
}

/** Call `told` with the milliseconds that the graphics card needs for all it was asked for so far. */
function timed(gl, told) {
  const start = performance.now();
  const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
  gl.flush();
  const look = () => {
    const done = gl.isContextLost() || gl.getSyncParameter(fence, gl.SYNC_STATUS) === gl.SIGNALED;
    if (!done) return void window.setTimeout(look, 4);
    gl.deleteSync(fence);
    return told(performance.now() - start);
  };
  window.setTimeout(look, 0);
}
