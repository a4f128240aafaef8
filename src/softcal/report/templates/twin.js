"use strict";
// The twin of a robot on a page: its reduced model, its shapes, a picture of it, sliders and a chart.
// The page holds all that is needed in its element "twin-data"; nothing is loaded.

/** A number as Python's "{:.6g}" writes it. */
function plain(x) {
  if (!Number.isFinite(x)) return Number.isNaN(x) ? "nan" : x > 0 ? "inf" : "-inf";
  const [digits, power] = x.toExponential(5).split("e").map(Number);
  if (power >= -4 && power < 6) return String(Number(x.toPrecision(6)));
  return `${digits}e${power < 0 ? "-" : "+"}${String(Math.abs(power)).padStart(2, "0")}`;
}

const dot = (a, b) => a.reduce((total, value, i) => total + value * b[i], 0);

/** Chebyshev polynomials in directions of the inputs, by the formulas of reduced_model.py; own: powers and coefficients. */
class Polynomials {
  constructor({ inputs, directions }, own) {
    Object.assign(this, { inputs, directions }, own);
    this.degree = Math.max(1, ...own.powers.flat());
  }

  /** Values at inputs [SI]. */
  at(inputs) {
    const s = this.inputs.map(({ least, most }, k) => (inputs[k] - 0.5 * (most + least)) / (0.5 * (most - least)));
    const T = this.directions.map((row) => {
      const t = dot(row, s), found = [1, t];
      while (found.length <= this.degree) found.push(2 * t * found.at(-1) - found.at(-2));
      return found;
    });
    const values = new Array(this.coefficients[0].length).fill(0);
    this.powers.forEach((powers, m) => {
      const term = powers.reduce((product, power, k) => product * T[k][power], 1);
      this.coefficients[m].forEach((coefficient, j) => { values[j] += term * coefficient; });
    });
    return values;
  }
}

/** The evaluator of `softcal export reduced`: inputs [SI] to poses of plates, coordinates, places of markers, and bands. */
class ReducedModel {
  constructor(model) {
    Object.assign(this, { model, inputs: model.inputs, outputs: new Polynomials(model, model) });
    this.squares = model.bands && new Polynomials(model, model.bands);
    const places = (names, keys) => names.flatMap((name) => keys.map((key) => `${name}.${key}`));
    const angles = places(model.plates, ["x", "y", "z", "pitch", "roll", "yaw"]);
    this.channels = [...angles, ...model.coordinates, ...places(model.markers, ["x", "y", "z"])];
  }

  /** The inputs in their order; refuses those that the model does not have. */
  read(given) {
    const names = this.inputs.map(({ name }) => name), at = this.inputs.map(({ default: value }) => value);
    for (const [name, value] of Object.entries(given)) {
      const k = names.indexOf(name);
      if (k < 0) throw new RangeError(`The model has no input '${name}'; it has ${names.join(", ")}.`);
      const { least, most, unit } = this.inputs[k];
      if (!(least <= value && value <= most)) {
        throw new RangeError(
          `${name}: ${plain(value)} ${unit} is outside the model, which holds from ${plain(least)} to ${plain(most)} ${unit}.`,
        );
      }
      at[k] = value;
    }
    return at;
  }

  state(given) {
    const at = this.read(given), values = this.outputs.at(at), { plates, coordinates, markers } = this.model;
    const first = 7 * plates.length, named = (names, value) => Object.fromEntries(names.map((name, k) => [name, value(k)]));
    const poses = plates.map((_, k) => {
      const q = values.slice(7 * k + 3, 7 * k + 7), size = Math.sqrt(dot(q, q));
      return { position: values.slice(7 * k, 7 * k + 3), quaternion: q.map((part) => part / size) };
    });
    const angles = poses.flatMap(({ position, quaternion: [x, y, z, w] }) => [
      ...position, // R = Ry(pitch) Rx(roll) Rz(yaw)
      Math.atan2(2 * (x * z + w * y), 1 - 2 * (x * x + y * y)),
      Math.asin(Math.max(-1, Math.min(1, -2 * (y * z - w * x)))),
      Math.atan2(2 * (x * y + w * z), 1 - 2 * (x * x + z * z)),
    ]);
    const channels = named(this.channels, (k) => (k < angles.length ? angles[k] : values[k + plates.length]));
    this.inputs.forEach(({ name, control }, k) => { channels[control ? `${name}.${control}` : name] = at[k]; });
    const squares = this.squares ? this.squares.at(at) : [];
    return {
      plates: named(plates, (k) => poses[k]),
      coordinates: named(coordinates, (k) => values[first + k]),
      markers: named(markers, (k) => values.slice(first + coordinates.length + 3 * k).slice(0, 3)),
      channels,
      bands: named(squares.length ? this.channels : [], (k) => Math.sqrt(Math.max(squares[k], 0))),
    };
  }
}

const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;

/** Points (x, y, z one after the other) [m] of all that is drawn, over the inputs of a model. */
class Shapes {
  constructor(model, data) {
    const rest = new Float32Array(bytes(data.rest)), modes = new Int16Array(bytes(data.modes));
    Object.assign(this, { rest, shares: new Polynomials(model, data) });
    this.modes = Array.from({ length: data.n_modes }, (_, k) => modes.subarray(k * rest.length, (k + 1) * rest.length));
  }

  at(inputs) {
    const shares = this.shares.at(inputs), points = this.rest.slice();
    this.modes.forEach((mode, k) => {
      const share = shares[k];
      for (let i = 0; i < points.length; i += 1) points[i] += share * mode[i];
    });
    return points;
  }
}

const minus = (a, b) => a.map((value, i) => value - b[i]);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const length = Math.hypot(...a) || 1; return a.map((value) => value / length); };

const SHADER = [
  `#version 300 es
  in vec3 place; in float moved; uniform mat3 sight; uniform vec3 middle; uniform vec2 zoom; out vec3 seen; out float shade;
  void main() { seen = sight * (place - middle); shade = moved; gl_Position = vec4(seen.xy * zoom, -0.1 * seen.z * min(zoom.x, zoom.y), 1.0); }`,
  `#version 300 es
  precision highp float;
  in vec3 seen; in float shade; uniform vec3 shades[9]; uniform vec3 colour; uniform float opacity; uniform bool isScale; out vec4 pixel;
  void main() {
    vec3 normal = normalize(cross(dFdx(seen), dFdy(seen)));
    float light = 0.48 + 0.52 * abs(dot(normal, normalize(vec3(-0.35, 0.45, 0.82))));
    float at = clamp(shade, 0.0, 1.0) * 8.0; int low = min(int(at), 7);
    vec3 own = isScale ? mix(shades[low], shades[low + 1], at - float(low)) : colour;
    pixel = vec4(own * light * opacity, opacity);
  }`,
];

/** The picture: surfaces, and tubes around polylines, in a parallel projection that is turned by hand. */
class Picture {
  constructor(canvas, data, shapes) {
    const gl = canvas.getContext("webgl2", { antialias: true, premultipliedAlpha: true });
    if (!gl) throw new Error("This browser draws no WebGL: the numbers follow the sliders without the picture.");
    Object.assign(this, { canvas, gl, view: data.view, rest: shapes.rest, turned: 0, tilted: 0, closeness: 1 });
    const program = gl.createProgram();
    [gl.VERTEX_SHADER, gl.FRAGMENT_SHADER].forEach((kind, k) => {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, SHADER[k].trim());
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    });
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    gl.useProgram(program);
    this.uniform = (name) => gl.getUniformLocation(program, name);
    gl.uniform3fv(this.uniform("shades"), data.view.shades.flat());
    gl.uniform3fv(this.uniform("middle"), data.view.middle);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    let first = 0;
    this.parts = data.parts.map((part) => {
      const triangles = part.triangles ? new Uint32Array(bytes(part.triangles)) : tubeTriangles(part.n, part.sides);
      const made = { ...part, first, count: triangles.length, array: gl.createVertexArray() };
      first += part.n;
      gl.bindVertexArray(made.array);
      [["place", 3], ["moved", 1]].forEach(([name, size]) => {
        made[name] = gl.createBuffer();
        gl.bindBuffer(gl.ARRAY_BUFFER, made[name]);
        const place = gl.getAttribLocation(program, name);
        gl.enableVertexAttribArray(place);
        gl.vertexAttribPointer(place, size, gl.FLOAT, false, 0, 0);
      });
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, triangles, gl.STATIC_DRAW);
      return made;
    });
    this.parts.sort((a, b) => b.opacity - a.opacity); // what is seen through is drawn last
    this.listen();
  }

  /** Draw points; top: the displacement [m] at the end of the colours. */
  show(points, top) {
    const { gl, rest } = this, moved = new Float32Array(points.length / 3);
    for (let i = 0; i < moved.length; i += 1) {
      const [x, y, z] = [points[3 * i] - rest[3 * i], points[3 * i + 1] - rest[3 * i + 1], points[3 * i + 2] - rest[3 * i + 2]];
      moved[i] = Math.sqrt(x * x + y * y + z * z) / top;
    }
    for (const part of this.parts) {
      let place = points.subarray(3 * part.first, 3 * (part.first + part.n));
      let shade = moved.subarray(part.first, part.first + part.n);
      if (part.radii) {
        place = tubePoints(place, part.radii, part.sides);
        shade = Float32Array.from({ length: place.length / 3 }, (_, i) => shade[Math.min(Math.floor(i / part.sides), part.n - 1)]);
      }
      [["place", place], ["moved", shade]].forEach(([name, values]) => {
        gl.bindBuffer(gl.ARRAY_BUFFER, part[name]);
        gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
      });
    }
    this.draw();
  }

  draw() {
    const { gl, canvas, view } = this, ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((size) => Math.max(1, Math.round(size * ratio)));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.depthMask(true);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const [right, up, back] = view.camera, [c, s] = [Math.cos(this.turned), Math.sin(this.turned)];
    const [ct, st] = [Math.cos(this.tilted), Math.sin(this.tilted)];
    const mix = (a, x, b, y) => a.map((value, i) => x * value + y * b[i]);
    const axes = [mix(right, c, back, s), up, mix(right, -s, back, c)];
    const rows = [axes[0], mix(axes[1], ct, axes[2], -st), mix(axes[1], st, axes[2], ct)];
    gl.uniformMatrix3fv(this.uniform("sight"), true, rows.flat());
    const zoom = this.closeness * Math.min(width / view.half[0], height / view.half[1]);
    gl.uniform2f(this.uniform("zoom"), zoom / width, zoom / height);
    for (const part of this.parts) {
      gl.uniform1i(this.uniform("isScale"), part.colour ? 0 : 1);
      gl.uniform3fv(this.uniform("colour"), part.colour || [0, 0, 0]);
      gl.uniform1f(this.uniform("opacity"), part.opacity);
      gl.depthMask(part.opacity === 1); // what is seen through hides nothing of itself
      gl.bindVertexArray(part.array);
      gl.drawElements(gl.TRIANGLES, part.count, gl.UNSIGNED_INT, 0);
    }
  }

  turn(sideways, upwards) {
    this.turned += sideways;
    this.tilted = Math.max(-1.5, Math.min(1.5, this.tilted + upwards));
    this.draw();
  }

  zoom(factor) {
    this.closeness = Math.max(0.3, Math.min(20, this.closeness * factor));
    this.draw();
  }

  listen() {
    const { canvas } = this;
    let held = null;
    const hold = ({ clientX, clientY }) => { held = [clientX, clientY]; };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      hold(event);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!event.buttons || !held) return;
      this.turn(-0.008 * (event.clientX - held[0]), 0.008 * (event.clientY - held[1]));
      hold(event);
    });
    canvas.addEventListener("wheel", (event) => {
      if (document.activeElement !== canvas) return; // the page is scrolled
      event.preventDefault();
      this.zoom(Math.exp(-0.0015 * event.deltaY));
    });
    canvas.addEventListener("keydown", (event) => {
      const turns = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
      if (turns[event.key]) this.turn(...turns[event.key]);
      else if (event.key === "+" || event.key === "-") this.zoom(event.key === "+" ? 1.15 : 1 / 1.15);
      else return;
      event.preventDefault();
    });
    new ResizeObserver(() => this.draw()).observe(canvas);
  }
}

/** Points around a polyline, a ring of `sides` for each of its points, and its two ends. */
function tubePoints(path, radii, sides) {
  const n = radii.length, at = (i) => Array.from(path.subarray(3 * i, 3 * i + 3)), found = [];
  let across = [0, 0, 0];
  for (let i = 0; i < n; i += 1) {
    const along = unit(minus(at(Math.min(i + 1, n - 1)), at(Math.max(i - 1, 0))));
    const seed = Math.hypot(...across) ? across : Math.abs(along[0]) < 0.8 ? [1, 0, 0] : [0, 1, 0];
    across = unit(minus(seed, along.map((value) => value * dot(seed, along))));
    const other = cross(along, across);
    for (let k = 0; k < sides; k += 1) {
      const angle = (2 * Math.PI * k) / sides, c = radii[i] * Math.cos(angle), s = radii[i] * Math.sin(angle);
      at(i).forEach((value, j) => found.push(value + c * across[j] + s * other[j]));
    }
  }
  return Float32Array.from([...found, ...at(0), ...at(n - 1)]);
}

function tubeTriangles(n, sides) {
  const found = [], last = n * sides;
  for (let k = 0; k < sides; k += 1) {
    const next = (k + 1) % sides;
    for (let i = 0; i < n - 1; i += 1) {
      const [a, b, c, d] = [i * sides + k, i * sides + next, (i + 1) * sides + k, (i + 1) * sides + next];
      found.push(a, b, c, b, d, c);
    }
    found.push(last, next, k, last + 1, last - sides + k, last - sides + next);
  }
  return Uint32Array.from(found);
}

const wordsOf = (channel) => channel.split(/\.([^.]*)$/).slice(0, 2).reverse().join(" of ").replaceAll("_", " ");
const shown = (value, [unitName, factor]) => {
  const size = Math.abs(value * factor);
  return `${(value * factor).toFixed(size < 1 ? 3 : size < 10 ? 2 : 1).replace("-", "−")}${unitName === "°" ? "" : " "}${unitName}`;
};

/** Round numbers from low to high, some n of them. */
function ticks(low, high, n) {
  const raw = (high - low) / n || 1, power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= raw * 0.999);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) found.push(Number((k * step).toPrecision(12)));
  return found;
}

/** One channel over another one, with its band and the present state. */
class Chart {
  constructor(svg) {
    this.svg = svg;
  }

  add(name, attributes, text = "") {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    Object.entries(attributes).forEach(([key, value]) => made.setAttribute(key, value));
    made.textContent = text;
    this.svg.append(made);
  }

  /** curve: [up, across, half the width of its band] of each point, in the units of the axes; now: the present state;
   *  titles: of both axes. */
  show(curve, now, [upwards, sideways]) {
    const { svg } = this, [width, height] = [svg.clientWidth || 400, svg.clientHeight || 260];
    const [left, right, top, bottom] = [48, 14, 26, 42], range = (values) => {
      const [low, high] = [Math.min(...values), Math.max(...values)];
      return high - low > 1e-9 ? [low, high] : [low - 0.5, low + 0.5];
    };
    svg.replaceChildren();
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const [from, to] = range(curve.flatMap(([, across, half]) => [across - half, across + half]));
    const [low, high] = range([0, ...curve.map(([up]) => up)]);
    const x = (across) => left + ((across - from) / (to - from)) * (width - left - right);
    const y = (up) => height - bottom - ((up - low) / (high - low)) * (height - top - bottom);
    for (const tick of ticks(from, to, Math.max(3, width / 70))) {
      this.add("line", { class: "grid", x1: x(tick), x2: x(tick), y1: top, y2: height - bottom });
      this.add("text", { x: x(tick), y: height - bottom + 16, "text-anchor": "middle" }, String(tick).replace("-", "−"));
    }
    for (const tick of ticks(low, high, 5)) {
      this.add("line", { class: "grid", x1: left, x2: width - right, y1: y(tick), y2: y(tick) });
      this.add("text", { x: left - 6, y: y(tick) + 4, "text-anchor": "end" }, String(tick).replace("-", "−"));
    }
    const points = (line) => line.map(([up, across]) => `${x(across)},${y(up)}`).join(" ");
    const upper = curve.map(([up, across, half]) => [up, across + half]);
    const lower = curve.map(([up, across, half]) => [up, across - half]).reverse();
    this.add("polygon", { class: "band", points: points([...upper, ...lower]) });
    this.add("polyline", { class: "line", points: points(curve) });
    this.add("circle", { class: "now", cx: x(now[1]), cy: y(now[0]), r: 6 });
    this.add("text", { x: 4, y: 14 }, upwards);
    this.add("text", { x: width - right, y: height - 6, "text-anchor": "end" }, sideways);
  }
}

/** The page: what the sliders say goes into the picture, the table and the chart.
 *  data: the model, its shapes and parts, the view; the effort and the coordinate of each input, or one of both alone;
 *  efforts and measures: channels of the chart; units: channel -> unit and its factor. */
class Twin {
  static CURVE = 48; // steps of the chart
  static HALVINGS = 60; // of the efforts between which that of a coordinate lies

  constructor(root, data) {
    Object.assign(this, { root, data, units: data.units, model: new ReducedModel(data.model) });
    this.inputs = this.model.inputs;
    this.at = this.inputs.map(({ default: value }) => value);
    this.shapes = new Shapes(data.model, data.shapes);
    this.find = (name) => root.parentElement.querySelector(`[data-${name}]`);
    this.chart = new Chart(root.querySelector(".chart"));
    root.querySelector("[data-largest]").textContent = shown(data.view.largest, ["mm", 1e3]);
    root.querySelector(".shades").style.background = `linear-gradient(to right, ${data.view.shades
      .map((rgb) => `rgb(${rgb.map((value) => Math.round(255 * value)).join(" ")})`)
      .join(", ")})`;
    this.fill("effort", data.efforts);
    this.fill("measure", data.measures.filter((name) => !data.efforts.includes(name)));
    this.find("measure").value = data.first;
    root.querySelectorAll("[name=kind]").forEach((button) => button.addEventListener("change", () => this.place()));
    this.sliders = this.inputs.map((_, k) => this.slider(k));
    if (!this.model.squares) this.find("values").tHead.rows[0].deleteCell(2);
    try {
      this.picture = new Picture(root.querySelector("canvas"), data, this.shapes);
    } catch (error) {
      root.querySelector("figcaption").textContent = error.message;
    }
    new ResizeObserver(() => this.plot()).observe(this.chart.svg);
    const further = ({ default: value, least, most }) => (most - value < value - least ? least : most);
    this.set(this.inputs.map((input, k) => (k ? input.default : 0.4 * input.default + 0.6 * further(input))));
  }

  fill(name, channels) {
    channels.forEach((channel) => this.find(name).append(new Option(wordsOf(channel), channel)));
    this.find(name).addEventListener("change", () => this.plot());
  }

  slider(k) {
    const box = document.createElement("label"), input = document.createElement("input"), [effort, coordinate] = this.data.inputs[k];
    const [title, value] = [document.createElement("span"), document.createElement("output")], { name } = this.inputs[k];
    Object.assign(box, { className: "slider" });
    title.textContent = coordinate ? name : wordsOf(effort);
    Object.assign(input, { type: "range", step: "any", ariaLabel: title.textContent });
    input.addEventListener("input", () => {
      if (this.data.efforts.includes(effort)) this.find("effort").value = effort;
      const channel = this.channel(k), wanted = Number(input.value) / this.units[channel][1];
      this.set(this.at.with(k, channel === effort ? wanted : this.effortOf(k, wanted)), k);
    });
    input.addEventListener("keydown", (event) => {
      const steps = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 }[event.key];
      if (!steps) return;
      event.preventDefault();
      const [low, high] = [Number(input.min), Number(input.max)];
      input.value = Math.min(high, Math.max(low, Number(input.value) + (steps * (high - low)) / 100));
      input.dispatchEvent(new Event("input"));
    });
    box.append(title, value, input);
    this.find("sliders").append(box);
    return { input, value };
  }

  /** The channel that a slider sets: the effort, or the coordinate where that is chosen. */
  channel(k) {
    const byCoordinate = this.root.querySelector("[name=kind]:checked")?.value === "coordinate";
    return this.data.inputs[k].at(byCoordinate ? -1 : 0);
  }

  state(at) {
    return this.model.state(Object.fromEntries(this.inputs.map(({ name }, k) => [name, at[k]])));
  }

  /** A channel with an input at a value, and the others as they are. */
  with(k, value, channel) {
    return this.state(this.at.with(k, value)).channels[channel];
  }

  /** The effort at a coordinate, which rises or falls with it. */
  effortOf(k, wanted) {
    let { least: low, most: high } = this.inputs[k];
    const coordinate = this.channel(k), rises = this.with(k, low, coordinate) < this.with(k, high, coordinate);
    for (let n = 0; n < Twin.HALVINGS; n += 1) {
      const middle = 0.5 * (low + high);
      if (this.with(k, middle, coordinate) < wanted === rises) low = middle;
      else high = middle;
    }
    return 0.5 * (low + high);
  }

  /** Show a state; moved: the number of the slider that the hand is on, which stays where it is. */
  set(at, moved = -1) {
    this.at = at;
    this.picture?.show(this.shapes.at(at), this.data.view.largest || 1);
    const { channels, bands } = this.state(at);
    this.find("values").tBodies[0].replaceChildren(
      ...this.data.measures.map((channel) => {
        const row = document.createElement("tr"), texts = [wordsOf(channel), shown(channels[channel], this.units[channel])];
        if (channel in bands) texts.push(`± ${shown(bands[channel], this.units[channel])}`);
        texts.forEach((text, k) => Object.assign(row.insertCell(), { textContent: text, className: k ? "short" : "" }));
        return row;
      }),
    );
    this.place(moved);
    this.plot();
  }

  /** Put the sliders where the inputs are. */
  place(moved = -1) {
    const { channels } = this.state(this.at);
    this.sliders.forEach(({ input, value }, k) => {
      const channel = this.channel(k), factor = this.units[channel][1], { least, most } = this.inputs[k];
      if (k !== moved) {
        const ends = [least, most].map((end) => factor * this.with(k, end, channel)).sort((a, b) => a - b);
        Object.assign(input, { min: ends[0], max: ends[1] });
        input.value = channels[channel] * factor;
      }
      const both = [channel, ...this.data.inputs[k].filter((other) => other !== channel)];
      value.textContent = both.map((one) => shown(channels[one], this.units[one])).join(" · ");
      input.setAttribute("aria-valuetext", value.textContent);
    });
  }

  plot() {
    const effort = this.find("effort").value, measure = this.find("measure").value, { units } = this;
    const k = Math.max(this.data.inputs.findIndex(([channel]) => channel === effort), 0), { least, most } = this.inputs[k];
    const point = (at) => {
      const { channels, bands } = this.state(at);
      return [channels[effort] * units[effort][1], ...[channels[measure], bands[measure] ?? 0].map((value) => value * units[measure][1])];
    };
    const places = Array.from({ length: Twin.CURVE + 1 }, (_, n) => Math.min(least + ((most - least) * n) / Twin.CURVE, most)); // rounding leads beyond
    const titles = [effort, measure].map((channel) => `${wordsOf(channel)}${units[channel][0] && ` [${units[channel][0]}]`}`);
    this.chart.show(places.map((place) => point(this.at.with(k, place))), point(this.at), titles);
  }
}

document.querySelectorAll("[data-twin]").forEach((root) => {
  root.twin = new Twin(root, JSON.parse(document.getElementById("twin-data").textContent));
});
