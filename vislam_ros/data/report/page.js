"use strict";
// The charts, and what ties the scene to the series: a moment pointed at in one shows in the other.
(function () {
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const scene = document.getElementById("map");
  const series = document.getElementById("series");
  const narrow = window.matchMedia("(max-width: 600px)").matches;
  const config = { responsive: true, displaylogo: false, displayModeBar: narrow ? false : "hover" };

  function fail(element, error) {
    element.textContent = "This chart cannot be drawn here: " + error;
  }

  function nearest(times, time) {
    let low = 0;
    let high = times.length - 1;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] < time) { low = middle + 1; } else { high = middle; }
    }
    return low > 0 && time - times[low - 1] < times[low] - time ? low - 1 : low;
  }

  function tie() {
    const path = scene._fullData[0];
    const now = scene._fullData.length - 1;
    let wanted = null;
    function show() {
      const k = nearest(path.customdata, wanted);
      wanted = null;
      document.getElementById("now").textContent = path.customdata[k].toFixed(2) + " s: " +
        [path.x[k], path.y[k], path.z[k]].map((value) => value.toFixed(2)).join(", ") + " m";
      Plotly.restyle(
        scene, { x: [[path.x[k]]], y: [[path.y[k]]], z: [[path.z[k]]], visible: true }, [now]);
    }
    series.on("plotly_hover", function (event) {
      if (wanted === null) { window.requestAnimationFrame(show); }
      wanted = event.xvals ? event.xvals[0] : event.points[0].x;
    });
    scene.on("plotly_click", function (event) {
      const point = event.points[0];
      if (point.curveNumber !== 0) { return; }
      const time = point.customdata;
      Plotly.relayout(series, { shapes: [{
        type: "line", x0: time, x1: time, y0: 0, y1: 1, xref: "x", yref: "paper",
        line: { width: 1, dash: "dot" } }] });
    });
  }

  if (narrow) {
    figures.scene.data.forEach((trace) => {
      if (trace.marker && trace.marker.colorbar) { trace.marker.colorbar.len = 0.4; }
    });
    figures.series.layout.margin.l = 44;
  }
  // The text is painted first, then the map can be used, then the charts follow.
  function soon(action) {
    return new Promise((resolve) => window.setTimeout(resolve, 0)).then(action);
  }

  function drawn(name) {
    document.documentElement.dataset[name] = Math.round(performance.now());
  }

  soon(() => Plotly.newPlot(scene, figures.scene.data, figures.scene.layout, config))
    .catch((error) => fail(scene, error))
    .then(() => drawn("mapMs"))
    .then(() => soon(() => Plotly.newPlot(
      series, figures.series.data, figures.series.layout, config)))
    .catch((error) => fail(series, error))
    .then(function () {
      if (scene._fullData && series._fullData) { tie(); }
      drawn("drawnMs");
    });
})();
