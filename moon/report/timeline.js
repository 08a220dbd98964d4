"use strict";
// The timeline: a row for each machine, property and channel, on a canvas. Only what is visible is
// drawn, and of what shares a pixel only the first, so that a frame costs as much as the canvas is
// wide, however much was received. Times are microseconds from the start of the recording.
class Timeline {
  constructor(canvas, scroller, data) {
    this.canvas = canvas;
    this.scroller = scroller;
    this.data = data;
    this.end = Math.max(data.end, 1);
    this.pen = canvas.getContext("2d");
    this.selected = -1;
    this.onselect = () => {};
    this.onrange = () => {};
    this.ondraw = () => {};
    this.rows = [
      ...data.machines.map((row) => ({ machine: row, states: new Map(), height: 24 })),
      ...data.channels.map((row) => {
        const times = summed(row.t);
        return { channel: row, times, series: bySign(times, row.k), height: 19 };
      }),
    ];
    this.axis = 24;
    let top = this.axis;
    for (const row of this.rows) {
      row.top = top;
      top += row.height;
    }
    this.height = Math.max(top + 6, 60);
    this.marks = data.violations.map((mark, number) => ({ ...mark, number }));
    this.all();
    this.listen();
    this.resize();
  }

  // -- what is shown ---------------------------------------------------------------------------

  all() {
    const margin = this.end * 0.01;
    this.show(-margin, this.end + margin);
  }

  show(from, to) {
    const most = this.end * 1.2;
    const span = Math.min(Math.max(to - from, 20), most);
    const middle = (from + to) / 2;
    this.from = Math.min(Math.max(middle - span / 2, -this.end * 0.1), this.end * 1.1 - span);
    this.to = this.from + span;
    this.later();
  }

  // Where nothing is pointed at, the selected violation stays in its place.
  zoom(factor, at = this.fixed()) {
    this.show(at - (at - this.from) * factor, at + (this.to - at) * factor);
  }

  fixed() {
    const mark = this.marks[this.selected];
    return mark && mark.t >= this.from && mark.t <= this.to ? mark.t : (this.from + this.to) / 2;
  }

  move(part) {
    const step = (this.to - this.from) * part;
    this.show(this.from + step, this.to + step);
  }

  select(number, reveal = true) {
    this.selected = number;
    const mark = this.marks[number];
    if (reveal && mark && (mark.t < this.from || mark.t > this.to)) {
      const span = this.to - this.from;
      this.show(mark.t - span / 2, mark.t + span / 2);
    }
    const row = mark && mark.row >= 0 ? this.rows[mark.row] : null;
    if (reveal && row) {
      const seen = this.scroller;
      if (row.top < seen.scrollTop || row.top + row.height > seen.scrollTop + seen.clientHeight) {
        seen.scrollTop = Math.max(row.top - seen.clientHeight / 2, 0);
      }
    }
    this.later();
  }

  step(by) {
    const order = [...this.marks].sort((a, b) => a.t - b.t || a.number - b.number);
    if (!order.length) return;
    const now = order.findIndex((mark) => mark.number === this.selected);
    const next = now < 0 ? (by > 0 ? 0 : order.length - 1) : now + by;
    if (order[next]) this.onselect(order[next].number);
  }

  // -- places ----------------------------------------------------------------------------------

  x(time) {
    return this.left + ((time - this.from) / (this.to - this.from)) * (this.width - this.left);
  }

  time(x) {
    return this.from + ((x - this.left) / (this.width - this.left)) * (this.to - this.from);
  }

  resize() {
    this.width = this.scroller.clientWidth;
    this.left = this.width < 560 ? 96 : 230;
    const scale = Math.min(window.devicePixelRatio || 1, 16000 / this.height);
    this.canvas.style.height = `${this.height}px`;
    this.canvas.width = Math.max(Math.round(this.width * scale), 1);
    this.canvas.height = Math.max(Math.round(this.height * scale), 1);
    this.pen.setTransform(scale, 0, 0, scale, 0, 0);
    this.draw();
  }

  later() {
    if (this.waiting || this.width === undefined) return;
    this.waiting = requestAnimationFrame(() => this.draw());
  }

  // -- drawing ---------------------------------------------------------------------------------

  draw() {
    this.waiting = 0;
    const style = getComputedStyle(document.documentElement);
    const colours = new Map();
    this.colour = (name) => {
      if (!colours.has(name)) colours.set(name, style.getPropertyValue(`--${name}`).trim());
      return colours.get(name);
    };
    const pen = this.pen;
    pen.fillStyle = this.colour("paper");
    pen.fillRect(0, 0, this.width, this.height);
    pen.font = "12px system-ui, Arial, sans-serif";
    pen.textBaseline = "middle";
    this.drawAxis();
    pen.save();
    pen.beginPath();
    pen.rect(this.left, this.axis, this.width - this.left, this.height - this.axis);
    pen.clip();
    for (const row of this.rows) row.machine ? this.drawBands(row) : this.drawTicks(row);
    this.drawMarks();
    pen.restore();
    this.drawLabels();
    this.canvas.dataset.from = this.from;
    this.canvas.dataset.to = this.to;
    this.onrange(this.from, this.to);
    this.ondraw();
    this.ondraw = () => {};
  }

  drawAxis() {
    const pen = this.pen;
    const step = niceStep((this.to - this.from) / Math.max((this.width - this.left) / 95, 1));
    pen.textAlign = "center";
    for (let at = Math.ceil(this.from / step) * step; at <= this.to; at += step) {
      const x = Math.round(this.x(at)) + 0.5;
      pen.strokeStyle = this.colour("rule");
      line(pen, x, this.axis - 6, x, this.height);
      pen.fillStyle = this.colour("quiet");
      if (x > this.left + 18 && x < this.width - 18) pen.fillText(timeText(at, step), x, 10);
    }
    pen.strokeStyle = this.colour("rule");
    line(pen, 0, this.axis + 0.5, this.width, this.axis + 0.5);
  }

  drawBands(row) {
    const pen = this.pen;
    const bands = row.machine.bands;
    const top = row.top + 3;
    const height = row.height - 6;
    let covered = -1;
    pen.textAlign = "left";
    for (let i = firstEndingAfter(bands, this.from); i < bands.length; i++) {
      const [start, end, state, verdict] = bands[i];
      if (start > this.to) break;
      const left = Math.max(this.x(start), this.left);
      const right = Math.min(Math.max(this.x(end), left + (i === bands.length - 1 ? 4 : 1)), this.width);
      if (right <= covered + 0.5) continue;
      covered = right;
      pen.fillStyle = this.colour(state ? `band-${stateNumber(row.states, state) % 3}` : "field");
      pen.fillRect(left, top, right - left, height);
      if (verdict === 1) {
        pen.fillStyle = this.colour("bad");
        pen.fillRect(left, top + height - 5, right - left, 5);
      } else if (verdict >= 2) {
        hatch(pen, left, top + height - 5, right - left, 5, this.colour(verdict === 2 ? "unknown" : "rule"));
      }
      pen.strokeStyle = this.colour("paper");
      line(pen, left, top, left, top + height);
      const words = state || ["", "violated", "inconclusive", "unseen"][verdict];
      if (right - left > 26 && words) {
        pen.fillStyle = this.colour("ink");
        pen.fillText(fitted(pen, words, right - left - 8), left + 4, top + height / 2 - (verdict ? 1 : 0));
      }
    }
  }

  drawTicks(row) {
    const pen = this.pen;
    const middle = row.top + row.height / 2;
    const half = row.height / 2 - 3;
    const perPixel = (this.to - this.from) / (this.width - this.left);
    const shapes = {
      m: ["accent", 0, 1.5, middle - half, 2 * half], q: ["ink", 0.5, 2, middle - half, half - 0.5],
      r: ["ink", 0.5, 2, middle + 0.5, half - 0.5], x: ["bad", 2, 5, middle - 2.5, 5],
    };
    for (const [sign, times] of row.series) {
      const [colour, inset, width, top, height] = shapes[sign];
      pen.fillStyle = this.colour(colour);
      let i = lowerBound(times, this.from - perPixel * 4);
      let start = 0;
      let end = -1; // of the rectangle to be drawn: ticks that touch are one
      while (i < times.length && times[i] <= this.to + perPixel * 4) {
        const x = Math.round(this.x(times[i]));
        if (x - inset > end) {
          if (end >= 0) pen.fillRect(start, top, end - start, height);
          start = x - inset;
        }
        end = x - inset + width;
        i = Math.max(lowerBound(times, this.time(x + 0.5), i), i + 1);
      }
      if (end >= 0) pen.fillRect(start, top, end - start, height);
    }
  }

  drawMarks() {
    const pen = this.pen;
    const drawn = new Set();
    for (const mark of this.marks) {
      const x = Math.round(this.x(mark.t));
      if (x < this.left - 8 || x > this.width + 8) continue;
      const row = this.rows[mark.row];
      const top = row && mark.row >= 0 ? row.top : this.axis;
      const chosen = mark.number === this.selected;
      const place = `${x}:${mark.row}`;
      if (drawn.has(place) && !chosen) continue;
      drawn.add(place);
      if (chosen) {
        pen.globalAlpha = 0.22; // what led there
        pen.fillStyle = this.colour("mark");
        const since = Math.max(this.x(mark.since), this.left);
        pen.fillRect(since, this.axis, Math.max(x - since, 0), this.height);
        pen.globalAlpha = 1;
        pen.strokeStyle = this.colour("bad");
        line(pen, x + 0.5, this.axis, x + 0.5, this.height);
      }
      const size = chosen ? 8 : 5.5;
      pen.fillStyle = this.colour("bad");
      pen.beginPath();
      pen.moveTo(x - size, top + 1);
      pen.lineTo(x + size, top + 1);
      pen.lineTo(x, top + 1 + size * 1.7);
      pen.fill();
    }
  }

  drawLabels() {
    const pen = this.pen;
    pen.fillStyle = this.colour("paper");
    pen.fillRect(0, this.axis + 1, this.left - 1, this.height);
    pen.textAlign = "left";
    const first = this.rows.find((row) => row.channel);
    for (const row of this.rows) {
      if (row === first && row !== this.rows[0]) {
        pen.strokeStyle = this.colour("rule");
        line(pen, 0, row.top + 0.5, this.width, row.top + 0.5);
      }
      pen.fillStyle = this.colour(row.machine ? "ink" : "quiet");
      const name = row.machine ? row.machine.name : row.channel.name;
      pen.fillText(fitted(pen, name, this.left - 14, !row.machine), 6, row.top + row.height / 2);
    }
    pen.strokeStyle = this.colour("rule");
    line(pen, this.left - 0.5, 0, this.left - 0.5, this.height);
  }

  // -- what is where ---------------------------------------------------------------------------

  markAt(x, y) {
    let best = null;
    for (const mark of this.marks) {
      const away = Math.abs(this.x(mark.t) - x);
      const row = this.rows[mark.row];
      const top = row && mark.row >= 0 ? row.top : this.axis;
      if (away < 9 && y > top - 4 && y < top + 22 && (!best || away < best.away)) best = { mark, away };
    }
    return best && best.mark;
  }

  at(x, y) {
    if (x < this.left) {
      const row = this.rows.find((one) => y >= one.top && y < one.top + one.height);
      return row ? (row.machine ? row.machine.name : `${row.channel.name}\n${row.channel.type}\n${row.channel.received.toLocaleString()} received`) : "";
    }
    const row = this.rows.find((one) => y >= one.top && y < one.top + one.height);
    if (!row) return "";
    const time = this.time(x);
    if (row.machine) {
      const bands = row.machine.bands;
      const band = bands[firstEndingAfter(bands, time)];
      if (!band || band[0] > time) return "";
      const verdict = ["conforming", "violated", "inconclusive", "unseen"][band[3]];
      return `${row.machine.name}: ${verdict}${band[2] ? `, ${band[2]}` : ""}\nfrom ${timeText(band[0], 1)} to ${timeText(band[1], 1)}`;
    }
    const reach = ((this.to - this.from) / (this.width - this.left)) * 5;
    let best = -1;
    for (let i = lowerBound(row.times, time - reach); i < row.times.length && row.times[i] <= time + reach; i++) {
      if (best < 0 || Math.abs(row.times[i] - time) < Math.abs(row.times[best] - time)) best = i;
    }
    if (best < 0) return "";
    const what = { m: "message", q: "request", r: "response", x: "failed call" }[row.channel.k[best]];
    const from = this.data.sources[row.channel.f[best]];
    return `${timeText(row.times[best], 1)}  ${what} on ${row.channel.name}${from ? ` from ${from}` : ""}\n${this.data.texts[row.channel.s[best]]}`;
  }

  // -- hands -----------------------------------------------------------------------------------

  listen() {
    const canvas = this.canvas;
    const place = (event) => {
      const box = canvas.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    const held = new Map();
    let moved = 0;
    canvas.addEventListener("wheel", (event) => {
      if (event.shiftKey) return; // scrolls the rows
      event.preventDefault();
      const [x] = place(event);
      if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) this.move(event.deltaX / this.width);
      else this.zoom(Math.exp(Math.max(Math.min(event.deltaY, 240), -240) * 0.0022), this.time(Math.max(x, this.left)));
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      held.set(event.pointerId, place(event));
      moved = 0;
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      const [x, y] = place(event);
      const before = held.get(event.pointerId);
      if (!before) return this.point(event, x, y);
      const others = [...held].filter(([id]) => id !== event.pointerId);
      if (others.length) {
        const fixed = others[0][1][0];
        const was = Math.abs(before[0] - fixed);
        const is = Math.abs(x - fixed);
        if (was > 5 && is > 5) this.zoom(was / is, this.time(fixed));
      } else {
        this.move((before[0] - x) / (this.width - this.left));
      }
      moved += Math.abs(before[0] - x) + Math.abs(before[1] - y);
      held.set(event.pointerId, [x, y]);
    });
    const let_go = (event) => {
      if (held.delete(event.pointerId) && event.type === "pointerup" && moved < 5) {
        const mark = this.markAt(...place(event));
        if (mark) this.onselect(mark.number);
        else this.point(event, ...place(event));
      }
    };
    canvas.addEventListener("pointerup", let_go);
    canvas.addEventListener("pointercancel", let_go);
    canvas.addEventListener("pointerleave", () => this.ontip("", 0, 0));
    canvas.addEventListener("dblclick", () => this.all());
    const keys = {
      "+": () => this.zoom(0.6), "=": () => this.zoom(0.6), "-": () => this.zoom(1 / 0.6),
      "−": () => this.zoom(1 / 0.6), ArrowLeft: () => this.move(-0.15), ArrowRight: () => this.move(0.15),
      "0": () => this.all(), Home: () => this.all(), n: () => this.step(1), p: () => this.step(-1),
    };
    canvas.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || !keys[event.key]) return;
      event.preventDefault();
      keys[event.key]();
    });
    new ResizeObserver(() => {
      if (this.scroller.clientWidth !== this.width) this.resize();
    }).observe(this.scroller);
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.later());
  }

  point(event, x, y) {
    const mark = this.markAt(x, y);
    this.canvas.style.cursor = mark ? "pointer" : "crosshair";
    this.ontip(this.at(x, y), event.clientX, event.clientY);
  }

  ontip() {}
}

function summed(steps) {
  const times = new Float64Array(steps.length);
  let at = 0;
  for (let i = 0; i < steps.length; i++) times[i] = at += steps[i];
  return times;
}

// The times of each sign, so that what shares a pixel with another sign is drawn too.
function bySign(times, signs) {
  const found = new Map();
  for (let i = 0; i < times.length; i++) {
    if (!found.has(signs[i])) found.set(signs[i], []);
    found.get(signs[i]).push(times[i]);
  }
  return found;
}

function stateNumber(states, state) {
  if (!states.has(state)) states.set(state, states.size);
  return states.get(state);
}

function lowerBound(times, value, low = 0) {
  let high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] < value) low = middle + 1;
    else high = middle;
  }
  return low;
}

function firstEndingAfter(bands, time) {
  let low = 0;
  let high = bands.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (bands[middle][1] <= time) low = middle + 1;
    else high = middle;
  }
  return low;
}

function niceStep(least) {
  const power = 10 ** Math.floor(Math.log10(Math.max(least, 1)));
  return [1, 2, 5, 10].map((factor) => factor * power).find((step) => step >= least);
}

function timeText(time, step) {
  const digits = step >= 1e6 ? 0 : step >= 1e3 ? 3 : 6;
  return `${(time / 1e6).toFixed(digits)} s`;
}

function line(pen, x, y, to_x, to_y) {
  pen.beginPath();
  pen.moveTo(x, y);
  pen.lineTo(to_x, to_y);
  pen.stroke();
}

function hatch(pen, x, y, width, height, colour) {
  pen.save();
  pen.beginPath();
  pen.rect(x, y, width, height);
  pen.clip();
  pen.strokeStyle = colour;
  pen.beginPath();
  for (let at = x - height; at < x + width; at += 4) {
    pen.moveTo(at, y + height);
    pen.lineTo(at + height, y);
  }
  pen.stroke();
  pen.restore();
}

const widths = new Map();

function widthOf(pen, words) {
  let width = widths.get(words);
  if (width === undefined) {
    if (widths.size > 5000) widths.clear();
    widths.set(words, (width = pen.measureText(words).width));
  }
  return width;
}

function fitted(pen, words, width, fromEnd = false) {
  if (widthOf(pen, words) <= width) return words;
  let low = 0;
  let high = words.length;
  const cut = (length) => (fromEnd ? `…${words.slice(words.length - length)}` : `${words.slice(0, length)}…`);
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (widthOf(pen, cut(middle)) <= width) low = middle;
    else high = middle - 1;
  }
  return low > 2 ? cut(low) : "";
}
