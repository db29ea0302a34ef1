// Plots on canvases, drawn at most once per screen refresh and only when rows have come.
// A library redraws axes, legends and animations that stand still here: docs/panel.md has the measurement.
const GAP = { left: 58, right: 12, top: 8, bottom: 22 };

export default {
  template: `
    <div class="scope">
      <figure v-for="plot in plots" :key="plot.name" :class="'plot plot-' + plot.kind" :style="{ gridArea: plot.name }">
        <figcaption>
          <span class="plot-title">{{ plot.title }}</span>
          <span class="plot-legend"><span v-for="t in plot.traces.filter((t) => t.label)" :key="t.label"><svg width="22" height="8"
            ><line x1="0" y1="4" x2="22" y2="4" :style="{ stroke: 'var(--' + t.colour + ')' }" stroke-width="2.5"
            :stroke-dasharray="t.dashed ? '6 4' : null"/></svg>{{ t.label }}</span></span>
          <span class="plot-readouts" v-if="plot.readouts"></span>
          <output :id="'value-' + plot.name" class="plot-value">–</output>
        </figcaption>
        <canvas role="img" :aria-label="plot.title"></canvas>
      </figure>
    </div>`,
  props: { plots: Array, window: Number, history: Array, columns: Array },
  mounted() {
    this.rows = [];
    this.spans = {};
    this.drawn = 0;
    this.pushed = 0;
    this.observer = new ResizeObserver(() => this.later());
    this.find_figures();
    this.scheme = new MutationObserver(() => this.recolour());
    this.scheme.observe(document.body, { attributes: true, attributeFilter: ["class"] });
    this.recolour();
    this.push(this.history || []);
  },
  updated() {
    this.find_figures();
  },
  unmounted() {
    this.observer.disconnect();
    this.scheme.disconnect();
  },
  methods: {
    find_figures() {
      this.figures = [...this.$el.querySelectorAll("figure")];
      this.figures.forEach((figure) => this.observer.observe(figure));
      this.later();
    },
    push(rows) {
      if (rows.length && this.rows.length && rows[0][0] <= this.rows[this.rows.length - 1][0]) this.rows = [];
      this.rows.push(...rows);
      const last = this.rows.length ? this.rows[this.rows.length - 1][0] : 0;
      let old = 0;
      while (old < this.rows.length && this.rows[old][0] < last - this.window) old += 1;
      if (old) this.rows.splice(0, old);
      this.pushed += 1;
      this.later();
    },
    counts() {
      return { drawn: this.drawn, pushed: this.pushed, rows: this.rows.length };
    },
    recolour() {
      const style = getComputedStyle(document.body);
      const known = {}; // to ask the style anew for every line costs a layout of the page
      this.ink = (name) => (known[name] ??= style.getPropertyValue("--" + name).trim());
      this.later();
    },
    later() {
      if (this.waiting) return;
      this.waiting = true;
      requestAnimationFrame(() => {
        this.waiting = false;
        // all sizes first: one that is read after a text has changed costs a layout of the page
        const canvases = this.figures.map((figure) => figure.querySelector("canvas"));
        const sizes = canvases.map((canvas) => [canvas.clientWidth, canvas.clientHeight]);
        this.plots.forEach((plot, k) => this.draw(plot, this.figures[k], canvases[k], sizes[k]));
        this.drawn += 1;
      });
    },
    column(name) {
      return this.columns.indexOf(name);
    },
    draw(plot, figure, canvas, [width, height]) {
      const ratio = globalThis.devicePixelRatio || 1;
      if (!width || !height) return;
      if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
        canvas.width = Math.round(width * ratio);
        canvas.height = Math.round(height * ratio);
      }
      const pen = canvas.getContext("2d");
      pen.setTransform(ratio, 0, 0, ratio, 0, 0);
      pen.clearRect(0, 0, width, height);
      pen.font = "12px system-ui, sans-serif";
      const box = { x: GAP.left, y: GAP.top, w: width - GAP.left - GAP.right, h: height - GAP.top - GAP.bottom };
      const lines = plot.traces.map((t) => this.points(plot, t));
      const xs = plot.kind === "time" ? this.time_span() : this.span(plot.name + "-x", lines, 0, plot.least_x);
      const ys = this.span(plot.name, lines, 1, plot.least, plot.band ? this.band(plot) : 0);
      const at = (x, y) => [
        box.x + (box.w * (x - xs[0])) / (xs[1] - xs[0]),
        box.y + box.h * (1 - (y - ys[0]) / (ys[1] - ys[0])),
      ];
      this.axes(pen, box, xs, ys, plot, at);
      pen.save();
      pen.beginPath();
      pen.rect(box.x, box.y - 2, box.w + 2, box.h + 4);
      pen.clip();
      if (plot.band) this.shade(pen, box, this.band(plot), at);
      plot.traces.forEach((t, k) => this.line(pen, lines[k], t, at));
      if (plot.kind === "loop") this.head(pen, lines[0], plot.traces[0], at);
      pen.restore();
      if (!this.rows.length && plot.name === "displacement") {
        pen.fillStyle = this.ink("muted");
        pen.font = "16px system-ui, sans-serif";
        pen.textAlign = "center";
        pen.fillText("nothing measured yet: blocks flow while the stage is enabled", box.x + box.w / 2, box.y + box.h / 2);
      }
      this.value(plot, figure, lines);
    },
    points(plot, trace) {
      const x = this.column(plot.x);
      const y = this.column(trace.column);
      const found = [];
      for (const row of this.rows) {
        if (row[x] === null || row[y] === null) found.push(null);
        else found.push([row[x] * plot.scale_x, row[y] * plot.scale]);
      }
      return found;
    },
    spread(name) {
      // twice the rms over the window: a width that every observer has, whatever it knows of its own error
      const y = this.column(name);
      let sum = 0;
      let count = 0;
      for (const row of this.rows) {
        if (row[y] !== null) {
          sum += row[y] * row[y];
          count += 1;
        }
      }
      return count ? 2 * Math.sqrt(sum / count) : 0;
    },
    band(plot) {
      return this.spread(plot.traces[0].column) * plot.scale;
    },
    time_span() {
      const last = this.rows.length ? this.rows[this.rows.length - 1][0] : 0;
      return [last - this.window, last];
    },
    span(name, lines, axis, least, band = 0) {
      let low = Infinity;
      let high = -Infinity;
      for (const line of lines)
        for (const p of line)
          if (p) {
            if (p[axis] < low) low = p[axis];
            if (p[axis] > high) high = p[axis];
          }
      if (low > high) [low, high] = [0, least];
      [low, high] = [Math.min(low, -band || low), Math.max(high, band || high)];
      const room = Math.max(0.06 * (high - low), 0.5 * (least - (high - low)));
      const wanted = [low - room, high + room];
      const before = this.spans[name];
      // grows at once, shrinks slowly: a scale that jumps about cannot be read
      const now = before
        ? [Math.min(wanted[0], before[0] + 0.05 * (wanted[0] - before[0])),
           Math.max(wanted[1], before[1] + 0.05 * (wanted[1] - before[1]))]
        : wanted;
      this.spans[name] = now;
      return now;
    },
    axes(pen, box, xs, ys, plot, at) {
      pen.lineWidth = 1;
      pen.strokeStyle = this.ink("grid");
      pen.fillStyle = this.ink("muted");
      pen.textBaseline = "middle";
      pen.textAlign = "right";
      for (const y of ticks(ys, Math.max(3, Math.floor(box.h / 30)))) {
        const [, py] = at(xs[0], y);
        stroke(pen, [[box.x, py], [box.x + box.w, py]]);
        pen.fillText(label(y), box.x - 6, py);
      }
      pen.textBaseline = "top";
      pen.textAlign = "center";
      for (const x of ticks(xs, plot.kind === "time" ? 5 : Math.max(3, Math.floor(box.w / 55)))) {
        const [px] = at(x, ys[0]);
        stroke(pen, [[px, box.y], [px, box.y + box.h]]);
        pen.fillText(label(x) + (plot.kind === "time" ? " s" : ""), px, box.y + box.h + 6);
      }
      pen.textAlign = "left";
      pen.textBaseline = "top";
      pen.fillText(plot.unit, box.x + 5, box.y + 1);
      if (plot.kind === "loop") {
        pen.textAlign = "right";
        pen.textBaseline = "bottom";
        pen.fillText(plot.unit_x, box.x + box.w - 3, box.y + box.h - 3);
      }
    },
    line(pen, points, trace, at) {
      pen.strokeStyle = this.ink(trace.colour);
      pen.lineWidth = trace.dashed ? 1.6 : 1.8;
      pen.lineJoin = "bevel"; // at this density a round one looks the same and costs more
      pen.setLineDash(trace.dashed ? [6, 4] : []);
      pen.beginPath();
      for (const part of parts(points)) stroke_along(pen, thinned(part, at));
      pen.stroke();
      pen.setLineDash([]);
    },
    head(pen, points, trace, at) {
      const last = points[points.length - 1];
      if (!last) return;
      const [x, y] = at(last[0], last[1]);
      pen.fillStyle = this.ink(trace.colour);
      pen.beginPath();
      pen.arc(x, y, 4.5, 0, 2 * Math.PI);
      pen.fill();
    },
    shade(pen, box, band, at) {
      const [, top] = at(0, band);
      const [, bottom] = at(0, -band);
      pen.fillStyle = this.ink("band");
      pen.fillRect(box.x, top, box.w, bottom - top);
    },
    value(plot, figure, lines) {
      const last = lines[0].length ? lines[0][lines[0].length - 1] : null;
      const text = last ? number(last[1], plot.digits) + " " + plot.unit : "–";
      const shown = figure.querySelector("output");
      shown.textContent = plot.band && last ? text + ", 2σ " + number(this.band(plot), plot.digits) : text;
      if (plot.readouts) figure.querySelector(".plot-readouts").textContent = this.readouts(plot).join("   ");
    },
    readouts(plot) {
      const last = this.rows[this.rows.length - 1];
      if (!last) return [];
      return plot.readouts.map((r) => {
        const value = last[this.column(r.column)];
        const text = value === null ? "–" : number(value * r.scale, r.digits);
        const width = r.spread ? " ± " + number(this.spread(r.spread) * r.scale, r.digits) : "";
        return r.label + " " + text + width + " " + r.unit;
      });
    },
  },
};

function stroke(pen, points) {
  pen.beginPath();
  stroke_along(pen, points);
  pen.stroke();
}

function stroke_along(pen, points) {
  points.forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
}

function parts(points) {
  // what lies between gaps
  const found = [[]];
  for (const p of points) {
    if (p !== null) found[found.length - 1].push(p);
    else if (found[found.length - 1].length) found.push([]);
  }
  return found;
}

function thinned(points, at) {
  // of those that follow one another in one column of pixels the lowest and the highest: a line through all looks the same
  const found = [];
  let column = null;
  let low = null;
  let high = null;
  const close = () => {
    if (low === null) return;
    if (low[2] === high[2]) found.push(low);
    else found.push(...(low[2] < high[2] ? [low, high] : [high, low]));
  };
  points.forEach((p, k) => {
    const [x, y] = at(p[0], p[1]);
    const here = [x, y, k];
    if (Math.floor(x) !== column) {
      close();
      column = Math.floor(x);
      [low, high] = [here, here];
    } else {
      if (y < low[1]) low = here;
      if (y > high[1]) high = here;
    }
  });
  close();
  return found;
}

function ticks([low, high], count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 2.5, 5, 10].find((s) => s * power >= rough) * power;
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high; k += 1) found.push(k * step);
  return found;
}

function label(value) {
  return number(Number(value.toPrecision(6)));
}

function number(value, digits) {
  const text = digits === undefined ? String(value) : value.toFixed(digits);
  return text.replace("-", "−");
}
