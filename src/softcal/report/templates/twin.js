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

/** Tensor-product cubic Hermite polynomials over a grid: values at tensions `at`, and their derivatives along `rates`.
 *  table: at each node of the first axis the values and the slopes, each over the other axes. */
function channels(axes, at, rates, table) {
  const axis = axes[0];
  let i = 1;
  while (i < axis.length - 1 && axis[i] <= at[0]) i += 1;
  const h = axis[i] - axis[i - 1], s = (at[0] - axis[i - 1]) / h, r = rates[0] / h;
  const weights = [(1 + 2 * s) * (1 - s) ** 2, h * s * (1 - s) ** 2, s * s * (3 - 2 * s), h * s * s * (s - 1)];
  const changes = [-6 * s * (1 - s) * r, h * (1 - s) * (1 - 3 * s) * r, 6 * s * (1 - s) * r, h * s * (3 * s - 2) * r];
  const ends = [...table[i - 1], ...table[i]].map((end) =>
    axes.length > 1 ? channels(axes.slice(1), at.slice(1), rates.slice(1), end) : { values: end, rates: null },
  );
  const n = ends[0].values.length, found = { values: new Array(n).fill(0), rates: new Array(n).fill(0) };
  ends.forEach((end, k) => {
    const weight = weights[k], change = changes[k];
    for (let j = 0; j < n; j += 1) {
      found.values[j] += weight * end.values[j];
      found.rates[j] += change * end.values[j] + (end.rates ? weight * end.rates[j] : 0);
    }
  });
  return found;
}

/** The evaluator of `softcal export reduced`, by the formulas of reduced_model.py: tensions [N] to poses of plates,
 *  shortenings [m] and compliance. */
class ReducedModel {
  constructor(model) {
    Object.assign(this, { model, cables: model.cables, axes: model.axes, rows: model.rows });
  }

  /** The tensions in the order of the cables; refuses those that the model does not have. */
  tensions(given) {
    for (const name of Object.keys(given).sort()) {
      if (!this.cables.includes(name)) {
        throw new RangeError(`The model has no cable '${name}'; it has ${this.cables.join(", ")}.`);
      }
    }
    return this.cables.map((name, k) => {
      const t = given[name] ?? 0, end = this.axes[k].at(-1);
      if (!(t >= 0 && t <= end)) {
        throw new RangeError(`${name}: ${plain(t)} N is outside the model, which holds from 0 to ${plain(end)} N.`);
      }
      return t;
    });
  }

  state(given) {
    const at = this.tensions(given), plates = {}, columns = [];
    let shortenings = {};
    for (let k = 0; k < at.length; k += 1) {
      const { values, rates } = channels(this.axes, at, at.map((_, j) => (j === k ? 1 : 0)), this.model.nodes);
      const column = [];
      this.model.plates.forEach((name, i) => {
        const position = values.slice(7 * i, 7 * i + 3), q = values.slice(7 * i + 3, 7 * i + 7);
        const size = Math.sqrt(q.reduce((total, part) => total + part * part, 0));
        const quaternion = q.map((part) => part / size), [a, b, c, d] = quaternion;
        const [x, y, z, w] = rates.slice(7 * i + 3, 7 * i + 7);
        const turn = [d * x - a * w + b * z - c * y, d * y - b * w + c * x - a * z, d * z - c * w + a * y - b * x];
        column.push(...rates.slice(7 * i, 7 * i + 3), ...turn.map((part) => (2 * part) / size));
        plates[name] = { position, quaternion };
      });
      const first = 7 * this.model.plates.length;
      column.push(...rates.slice(first));
      shortenings = Object.fromEntries(this.model.shortenings.map((name, j) => [name, values[first + j]]));
      columns.push(column);
    }
    return { plates, shortenings, compliance: columns[0].map((_, row) => columns.map((column) => column[row])) };
  }
}

const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;

/** Points (x, y, z one after the other) [m] of all that is drawn, over tensions. */
class Shapes {
  constructor(data, axes) {
    const rest = new Float32Array(bytes(data.rest)), modes = new Int16Array(bytes(data.modes));
    Object.assign(this, { axes, rest, nodes: data.nodes });
    this.modes = Array.from({ length: data.n_modes }, (_, k) => modes.subarray(k * rest.length, (k + 1) * rest.length));
  }

  at(tensions) {
    const shares = channels(this.axes, tensions, tensions.map(() => 0), this.nodes).values;
    const points = this.rest.slice();
    this.modes.forEach((mode, k) => {
      const share = shares[k];
      for (let i = 0; i < points.length; i += 1) points[i] += share * mode[i];
    });
    return points;
  }
}

const minus = (a, b) => a.map((value, i) => value - b[i]);
const dot = (a, b) => a.reduce((total, value, i) => total + value * b[i], 0);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const length = Math.hypot(...a) || 1; return a.map((value) => value / length); };

/** What is measured of a state: name -> value [m; rad]; turned and moved are counted from the state without tension. */
class Measures {
  constructor(data, model, shapes) {
    Object.assign(this, { data, model, shapes });
    let first = 0;
    const middles = data.parts.map(({ n }) => { first += n; return first - n + Math.floor(n / 2); });
    this.markers = Object.fromEntries(data.markers.map((name, k) => [name, middles.at(k - data.markers.length)]));
    this.rest = model.state({});
    this.names = data.measures;
  }

  of(state, points) {
    const found = {}, at = (all, i) => Array.from(all.subarray(3 * i, 3 * i + 3));
    for (const [name, { position, quaternion: [x, y, z, w] }] of Object.entries(state.plates)) {
      const { position: before, quaternion: [a, b, c, d] } = this.rest.plates[name];
      const turn = [d * x - a * w + b * z - c * y, d * y - b * w + c * x - a * z, d * z - c * w + a * y - b * x];
      found[`${name}.rotation`] = 2 * Math.atan2(Math.hypot(...turn), Math.abs(a * x + b * y + c * z + d * w));
      found[`${name}.displacement`] = Math.hypot(...minus(position, before));
    }
    for (const [name, i] of Object.entries(this.markers)) {
      found[`${name}.displacement`] = Math.hypot(...minus(at(points, i), at(this.shapes.rest, i)));
    }
    for (const [name, value] of Object.entries(state.shortenings)) found[`${name}.shortening`] = value;
    return found;
  }

  /** Half the width of the 95 % band of each measure; none where the page has no bands. */
  bands(tensions) {
    if (!this.data.bands) return {};
    const { values } = channels(this.model.axes, tensions, tensions.map(() => 0), this.data.bands);
    return Object.fromEntries(this.names.map((name, k) => [name, Math.max(values[k], 0)]));
  }
}

/** One pull that was solved at several steps: what is measured of it, over the place along it. */
class Path {
  constructor({ name, kind, axes, measures, nodes }) {
    Object.assign(this, { cables: [name], kind: UNITS[kind], axes, names: measures, nodes });
    this.pulled = measures.filter((measure) => measure.endsWith(".tension")).map((measure) => measure.slice(0, -8));
  }

  state(given) {
    const { values } = channels(this.axes, [given[this.cables[0]]], [0], this.nodes);
    return Object.fromEntries(this.names.map((name, k) => [name, values[k]]));
  }

  of(state) {
    return state;
  }

  bands() {
    return {};
  }
}

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

const UNITS = { step: ["", 1], rotation: ["°", 180 / Math.PI], displacement: ["mm", 1e3], shortening: ["mm", 1e3], tension: ["N", 1] };
const kindOf = (measure) => UNITS[measure.slice(measure.lastIndexOf(".") + 1)];
const wordsOf = (measure) => `${measure.slice(measure.lastIndexOf(".") + 1)} of ${measure.slice(0, measure.lastIndexOf("."))}`;
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

/** Tension of one cable over a measure, the other cables as they are, with its band and the present state. */
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

  /** curve: [tension, value, half the width of the band] of each of its points; now: the same of the present state. */
  show(curve, now, cable, measure) {
    const { svg } = this, kind = kindOf(measure), [width, height] = [svg.clientWidth || 400, svg.clientHeight || 260];
    const [left, right, top, bottom] = [44, 14, 26, 42];
    svg.replaceChildren();
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const ends = curve.flatMap(([, value, half]) => [(value - half) * kind[1], (value + half) * kind[1]]);
    const [low, high, most] = [Math.min(...ends), Math.max(...ends), Math.max(...curve.map(([tension]) => tension)) || 1];
    const [from, to] = high - low > 1e-9 ? [low, high] : [low - 0.5, low + 0.5];
    const x = (value) => left + ((value * kind[1] - from) / (to - from)) * (width - left - right);
    const y = (tension) => height - bottom - (tension / most) * (height - top - bottom);
    for (const tick of ticks(from, to, Math.max(3, width / 70))) {
      const at = x(tick / kind[1]);
      this.add("line", { class: "grid", x1: at, x2: at, y1: top, y2: height - bottom });
      this.add("text", { x: at, y: height - bottom + 16, "text-anchor": "middle" }, String(tick));
    }
    for (const tick of ticks(0, most, 5)) {
      this.add("line", { class: "grid", x1: left, x2: width - right, y1: y(tick), y2: y(tick) });
      this.add("text", { x: left - 6, y: y(tick) + 4, "text-anchor": "end" }, String(tick));
    }
    const points = (line) => line.map(([tension, value]) => `${x(value)},${y(tension)}`).join(" ");
    const upper = curve.map(([tension, value, half]) => [tension, value + half]);
    const lower = curve.map(([tension, value, half]) => [tension, value - half]).reverse();
    this.add("polygon", { class: "band", points: points([...upper, ...lower]) });
    this.add("polyline", { class: "line", points: points(curve) });
    this.add("circle", { class: "now", cx: x(now[1]), cy: y(now[0]), r: 6 });
    this.add("text", { x: 4, y: 14 }, `tension of ${cable} [N]`);
    this.add("text", { x: width - right, y: height - 6, "text-anchor": "end" }, `${wordsOf(measure)} [${kind[0]}]`);
  }
}

/** The page: what the sliders say goes into the picture, the table and the chart. */
class Twin {
  static CURVE = 48; // steps of the chart
  static HALVINGS = 60; // of the tensions between which that of a shortening lies

  constructor(root, data) {
    this.root = root;
    this.data = data;
    this.model = data.path ? new Path(data.path) : new ReducedModel(data.model);
    this.shapes = new Shapes(data.shapes, this.model.axes);
    this.measures = data.path ? this.model : new Measures(data, this.model, this.shapes);
    this.tensions = this.model.axes.map((axis) => axis[0]);
    this.find = (name) => root.parentElement.querySelector(`[data-${name}]`);
    this.chart = new Chart(root.querySelector(".chart"));
    this.top = this.largest(data);
    root.querySelector("[data-largest]").textContent = shown(this.top, UNITS.displacement);
    root.querySelector(".shades").style.background = `linear-gradient(to right, ${data.view.shades
      .map((rgb) => `rgb(${rgb.map((value) => Math.round(255 * value)).join(" ")})`)
      .join(", ")})`;
    this.fill("cable", this.model.pulled ?? this.model.cables, (name) => name);
    this.fill("measure", this.measures.names.filter((name) => !name.endsWith(".tension")), wordsOf);
    this.find("measure").value = this.measures.names.findLast((name) => name.endsWith(".rotation")) ?? this.measures.names[0];
    root.querySelectorAll("[name=kind]").forEach((button) => button.addEventListener("change", () => this.place()));
    this.sliders = this.model.cables.map((name, k) => this.slider(name, k));
    if (!data.bands) this.find("values").tHead.rows[0].deleteCell(2);
    try {
      this.picture = new Picture(root.querySelector("canvas"), data, this.shapes);
    } catch (error) {
      root.querySelector("figcaption").textContent = error.message;
    }
    new ResizeObserver(() => this.plot()).observe(this.chart.svg);
    this.set(this.model.axes.map((axis, k) => (k ? axis[0] : 0.4 * axis[0] + 0.6 * axis.at(-1))));
  }

  /** The largest displacement [m] at the corners of the grid of what has the colours of displacements. */
  largest(data) {
    let most = 0;
    for (let corner = 0; corner < 2 ** this.model.cables.length; corner += 1) {
      const points = this.shapes.at(this.model.axes.map((axis, k) => ((corner >> k) & 1 ? axis.at(-1) : axis[0])));
      let first = 0;
      for (const part of data.parts) {
        for (let i = 3 * first; !part.colour && i < 3 * (first + part.n); i += 3) {
          most = Math.max(most, Math.hypot(...[0, 1, 2].map((j) => points[i + j] - this.shapes.rest[i + j])));
        }
        first += part.n;
      }
    }
    return most || 1;
  }

  fill(name, values, words) {
    values.forEach((value) => this.find(name).append(new Option(words(value), value)));
    this.find(name).addEventListener("change", () => this.plot());
  }

  slider(name, k) {
    const box = document.createElement("label"), input = document.createElement("input");
    const [title, value] = [document.createElement("span"), document.createElement("output")];
    Object.assign(box, { className: "slider" });
    title.textContent = name;
    Object.assign(input, { type: "range", step: "any", ariaLabel: `Pull of ${name}` });
    input.addEventListener("input", () => {
      if (!this.model.pulled) this.find("cable").value = name;
      const pulled = Number(input.value) / this.kind[1];
      this.set(this.tensions.with(k, this.byLength ? this.tensionOf(k, pulled) : pulled), k);
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
    return { input, value, name };
  }

  get byLength() {
    return this.root.querySelector("[name=kind]:checked")?.value === "shortening";
  }

  get kind() {
    return this.model.kind ?? (this.byLength ? UNITS.shortening : UNITS.tension);
  }

  shortening(k, tension) {
    const { values } = channels(this.model.axes, this.tensions.with(k, tension), this.tensions.map(() => 0), this.model.model.nodes);
    return values[7 * this.model.model.plates.length + this.model.model.shortenings.indexOf(this.model.cables[k])];
  }

  /** The tension [N] of a cable at its shortening [m], the others' tensions as they are: lengths ascend with it. */
  tensionOf(k, length) {
    let [low, high] = [0, this.model.axes[k].at(-1)];
    for (let n = 0; n < Twin.HALVINGS; n += 1) {
      const middle = 0.5 * (low + high);
      if (this.shortening(k, middle) < length) low = middle;
      else high = middle;
    }
    return 0.5 * (low + high);
  }

  /** Show tensions [N]; moved: the number of the slider that the hand is on, which stays where it is. */
  set(tensions, moved = -1) {
    this.tensions = tensions;
    const named = Object.fromEntries(this.model.cables.map((name, k) => [name, tensions[k]]));
    const state = this.model.state(named), points = this.shapes.at(tensions), bands = this.measures.bands(tensions);
    this.picture?.show(points, this.top);
    const now = this.measures.of(state, points);
    this.find("values").tBodies[0].replaceChildren(
      ...this.measures.names.map((measure) => {
        const row = document.createElement("tr"), kind = kindOf(measure);
        const texts = [wordsOf(measure), shown(now[measure], kind)];
        if (measure in bands) texts.push(`± ${shown(bands[measure], kind)}`);
        texts.forEach((text, k) => Object.assign(row.insertCell(), { textContent: text, className: k ? "short" : "" }));
        return row;
      }),
    );
    this.place(moved);
    this.plot();
  }

  /** Put the sliders where the tensions are. */
  place(moved = -1) {
    const { kind } = this;
    this.sliders.forEach(({ input, value }, k) => {
      const [first, end] = [this.model.axes[k][0], this.model.axes[k].at(-1)], now = this.byLength ? this.shortening(k, this.tensions[k]) : this.tensions[k];
      if (k !== moved) {
        const range = this.byLength ? [this.shortening(k, 0), this.shortening(k, end)] : [first, end];
        Object.assign(input, { min: range[0] * kind[1], max: range[1] * kind[1] });
        input.value = now * kind[1];
      }
      value.textContent = this.model.kind
        ? shown(now, kind)
        : this.byLength
        ? `${shown(now, kind)} · ${shown(this.tensions[k], UNITS.tension)}`
        : `${shown(now, kind)} · ${shown(this.shortening(k, now), UNITS.shortening)}`;
      input.setAttribute("aria-valuetext", value.textContent);
    });
  }

  plot() {
    const cable = this.find("cable").value, measure = this.find("measure").value;
    const k = Math.max(this.model.cables.indexOf(cable), 0), axis = this.model.axes[k];
    const at = (place) => {
      const tensions = this.tensions.with(k, place);
      const state = this.model.state(Object.fromEntries(this.model.cables.map((name, j) => [name, tensions[j]])));
      const found = this.measures.of(state, this.data.markers.length ? this.shapes.at(tensions) : null);
      return [found[`${cable}.tension`] ?? place, found[measure], this.measures.bands(tensions)[measure] ?? 0];
    };
    const curve = Array.from({ length: Twin.CURVE + 1 }, (_, n) => at(Math.min(axis[0] + ((axis.at(-1) - axis[0]) * n) / Twin.CURVE, axis.at(-1)))); // rounding leads beyond
    this.chart.show(curve, at(this.tensions[k]), cable, measure);
  }
}

document.querySelectorAll("[data-twin]").forEach((root) => {
  root.twin = new Twin(root, JSON.parse(document.getElementById("twin-data").textContent));
});
