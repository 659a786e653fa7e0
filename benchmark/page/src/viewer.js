// A mesh to turn, drawn by three.js; loaded when the first row is opened.

import {
  AmbientLight, BufferAttribute, BufferGeometry, Color, DirectionalLight, DoubleSide, LineBasicMaterial,
  LineSegments, Mesh, MeshStandardMaterial, PerspectiveCamera, Scene, Spherical, Vector3, WebGLRenderer,
  WireframeGeometry,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { element } from "./dom.js";

const STEPS = 32767; // of shapes.py
const TURN = Math.PI / 18;
const ZOOM = 1.15;
const START = new Vector3(2.1, -2.9, 1.7).normalize();
const ANGLE = 35; // of view, in degrees
const [NEAREST, FARTHEST] = [0.4, 3]; // of the distance that shows all of a mesh

function bytes(text) {
  const raw = atob(text);
  return Uint8Array.from({ length: raw.length }, (_, i) => raw.charCodeAt(i)).buffer;
}

/** Return the geometry of a mesh as shapes.py packs it: little-endian, as all browsers are. */
function unpacked(packed) {
  const Index = packed.wide ? Uint32Array : Uint16Array;
  const geometry = new BufferGeometry();
  const positions = Float32Array.from(new Int16Array(bytes(packed.vertices)), (value) => value / STEPS);
  geometry.setAttribute("position", new BufferAttribute(positions, 3));
  geometry.setIndex(new BufferAttribute(new Index(bytes(packed.faces)), 1));
  return geometry;
}

/** Show a mesh in a container; return how to redraw and to close it. */
function view(container, packed, label) {
  const canvas = element("canvas", {
    tabindex: "0", role: "application", "aria-roledescription": "3D model",
    "aria-label": `${label}. Arrow keys turn it, plus and minus zoom, 0 resets.`,
  });
  const simplified = packed.shown < packed.face_count; // then its edges are not those of the mesh
  const count = (number) => number.toLocaleString("en");
  const counts = `${count(packed.vertex_count)} vertices, ${count(packed.face_count)} triangles` +
    (simplified ? `; simplified for display to ${count(packed.shown)}` : "");
  const context = canvas.getContext("webgl2", { alpha: true, antialias: true, preserveDrawingBuffer: true }) // for print;
  if (!context) {
    container.replaceChildren(element("p", {}, `This browser has no WebGL, so the mesh (${counts}) cannot be shown.`));
    return { redraw: () => {}, close: () => {} };
  }
  const renderer = new WebGLRenderer({ canvas, context });
  const scene = new Scene();
  const camera = new PerspectiveCamera(ANGLE, 1, 0.05, 50);
  camera.up.set(0, 0, 1);
  const geometry = unpacked(packed);
  geometry.computeBoundingSphere();
  const whole = geometry.boundingSphere.radius / Math.sin((ANGLE / 2) * (Math.PI / 180));
  const surface = new Mesh(geometry, new MeshStandardMaterial({ side: DoubleSide, flatShading: true, roughness: 0.75, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 }));
  const edges = new LineSegments(new WireframeGeometry(geometry), new LineBasicMaterial({ transparent: true, opacity: 0.3 }));
  edges.visible = !simplified;
  const light = new DirectionalLight(0xffffff, 2);
  light.position.set(1, 1.4, 1.2);
  camera.add(light);
  scene.add(camera, surface, edges, new AmbientLight(0xffffff, 1));

  const controls = new OrbitControls(camera, canvas);
  Object.assign(controls, { enablePan: false, enableZoom: false, minDistance: NEAREST * whole, maxDistance: FARTHEST * whole });
  canvas.style.touchAction = "pan-y"; // a finger that moves up or down scrolls the page
  canvas.addEventListener("focus", () => (controls.enableZoom = true)); // till then a wheel scrolls
  canvas.addEventListener("blur", () => (controls.enableZoom = false));

  function draw() {
    renderer.render(scene, camera);
    canvas.dataset.turned = `${controls.getAzimuthalAngle().toFixed(3)} ${controls.getPolarAngle().toFixed(3)}`;
    canvas.dataset.distance = controls.getDistance().toFixed(3);
  }
  function turn(around, up) {
    // three's spherical coordinates have y up, the shapes have z
    const at = new Spherical().setFromVector3(new Vector3(camera.position.x, camera.position.z, -camera.position.y));
    at.theta += around;
    at.phi = Math.min(Math.PI - 0.05, Math.max(0.05, at.phi - up));
    const to = new Vector3().setFromSpherical(at);
    camera.position.set(to.x, -to.z, to.y);
    controls.update();
    draw();
  }
  function zoom(factor) {
    camera.position.divideScalar(factor); // the controls keep it within its limits
    controls.update();
    draw();
  }
  function reset() {
    camera.position.copy(START).multiplyScalar(whole);
    controls.update();
    draw();
  }
  function paint() {
    surface.material.color = new Color(getComputedStyle(canvas).color);
    edges.material.color = new Color(getComputedStyle(document.body).color);
    draw();
  }
  function resize() {
    const { width, height } = container.querySelector(".canvas").getBoundingClientRect();
    if (!width) return;
    renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    draw();
  }
  const keys = {
    ArrowLeft: () => turn(-TURN, 0), ArrowRight: () => turn(TURN, 0), ArrowUp: () => turn(0, TURN), ArrowDown: () => turn(0, -TURN),
    "+": () => zoom(ZOOM), "=": () => zoom(ZOOM), "-": () => zoom(1 / ZOOM), 0: reset,
  };
  canvas.addEventListener("keydown", (event) => {
    if (!(event.key in keys) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    keys[event.key]();
  });
  controls.addEventListener("change", draw);

  const button = (name, text, click, more = {}) => element("button", { type: "button", "aria-label": name, title: name, click, ...more }, text);
  const toggle = button("Show edges", "edges", () => {
    edges.visible = !edges.visible;
    toggle.setAttribute("aria-pressed", String(edges.visible));
    draw();
  }, { "aria-pressed": String(edges.visible) });
  container.replaceChildren(
    element("div", { class: "canvas" }, canvas),
    element("div", { class: "buttons", role: "group", "aria-label": `Turn the mesh ${label}` },
      button("Turn left", "←", () => turn(-TURN, 0)), button("Turn right", "→", () => turn(TURN, 0)),
      button("Turn up", "↑", () => turn(0, TURN)), button("Turn down", "↓", () => turn(0, -TURN)),
      button("Zoom in", "+", () => zoom(ZOOM)), button("Zoom out", "−", () => zoom(1 / ZOOM)),
      button("Reset the view", "reset", reset), toggle),
    element("p", { class: "small" }, `${counts}.`));
  const observer = new ResizeObserver(resize);
  observer.observe(container.querySelector(".canvas"));
  reset();
  resize();
  paint();
  return {
    redraw: paint,
    close: () => {
      observer.disconnect();
      controls.dispose();
      geometry.dispose();
      edges.geometry.dispose();
      renderer.dispose();
      renderer.forceContextLoss(); // browsers keep few contexts
    },
  };
}

eigbench.view = view;
