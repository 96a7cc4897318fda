// What JavaScript libraries read: node browser_libraries.mjs KIND FILE, in a folder with node_modules; prints JSON.
import { createRequire } from "node:module";
import fs from "node:fs";
import { pathToFileURL } from "node:url";

const require = createRequire(`${process.cwd()}/package.json`);
const [kind, path, version] = process.argv.slice(2);
const load = (name) => import(pathToFileURL(require.resolve(name)).href);
const flat = (place, up) => (up === "y" ? [place.x, -place.z, place.y] : [place.x, place.y, place.z]);
const print = console.log;
console.log = console.warn = console.error = () => {};
globalThis.window ??= { addEventListener() {} };

const kinds = {
  "bcf-js": async (data) => {
    const { BcfReader } = require(`@parametricos/bcf-js/dist/${version}`);
    const reader = new BcfReader();
    await reader.read(data);
    return reader.project.markups.map((one) => {
      const view = one.viewpoints[0];
      return {
        title: one.topic.title, camera: flat(view.perspective_camera.camera_view_point, "z"),
        selected: (view.components.selection ?? []).map((each) => each.ifc_guid),
      };
    });
  },
  "@thatopen/components": async (data) => {
    const OBC = await import(pathToFileURL(`${process.cwd()}/node_modules/@thatopen/components/dist/index.mjs`).href)
      .catch(() => load("@thatopen/components"));
    const { topics, viewpoints } = await new OBC.Components().get(OBC.BCFTopics).load(new Uint8Array(data));
    const views = new Map([...viewpoints].map((one) => [one.guid, one]));
    return [...topics].map((topic) => {
      const view = views.get([...topic.viewpoints][0]);
      return {
        title: topic.title, camera: flat(view.camera.camera_view_point, "y"), selected: [...view.selectionComponents],
      };
    });
  },
  "web-ifc": async (data) => {
    const api = new (await load("web-ifc")).IfcAPI();
    await api.Init();
    const model = api.OpenModel(new Uint8Array(data));
    const elements = {};
    api.StreamAllMeshes(model, (mesh) => {
      const colours = new Set();
      for (let i = 0; i < mesh.geometries.size(); i++) {
        const { color } = mesh.geometries.get(i);
        colours.add([color.x, color.y, color.z].map((value) => Math.round(255 * value)).join());
      }
      elements[api.GetLine(model, mesh.expressID).GlobalId.value] = [...colours];
    });
    return elements;
  },
};
try {
  require.resolve(kind === "bcf-js" ? "@parametricos/bcf-js/package.json" : kind === "web-ifc" ? kind : `${kind}`);
} catch (error) {
  if (error.code === "MODULE_NOT_FOUND") process.exit(3);
}
print(JSON.stringify(await kinds[kind](fs.readFileSync(path))));
process.exit(0);
