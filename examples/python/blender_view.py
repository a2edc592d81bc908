"""What Blender shows of a model that it has just opened:
blender -b --factory-startup -P blender_view.py -- MODEL PICTURE WxH

By its Workbench, which draws the viewport's solid view, from the direction of the startup file's camera, with all of
the model in the picture (the Home key). Needs a screen, or xvfb-run. For contact_sheet.py.
"""

import math
import sys
from pathlib import Path

import bpy
from mathutils import Euler, Vector

IMPORTERS = {
    ".obj": lambda file: bpy.ops.wm.obj_import(filepath=file),
    ".ply": lambda file: bpy.ops.import_mesh.ply(filepath=file),
    ".stl": lambda file: bpy.ops.import_mesh.stl(filepath=file),
    ".gltf": lambda file: bpy.ops.import_scene.gltf(filepath=file),
    ".glb": lambda file: bpy.ops.import_scene.gltf(filepath=file),
}
STARTUP_TURN = tuple(math.radians(angle) for angle in (63.559, 0.0, 46.692))


def main(model, picture, size):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if Path(model).suffix.lower() not in IMPORTERS:
        sys.exit(f"Blender does not open {Path(model).suffix} by itself")
    IMPORTERS[Path(model).suffix.lower()](model)
    scene = bpy.context.scene
    corners = [o.matrix_world @ Vector(c) for o in scene.objects if o.type == "MESH" for c in o.bound_box]
    if not corners:
        sys.exit("nothing to be seen")
    low, high = (Vector(map(f, *corners)) for f in (min, max))
    scene.render.resolution_x, scene.render.resolution_y = map(int, size.split("x"))
    camera = bpy.data.objects.new("view", bpy.data.cameras.new("view"))
    scene.collection.objects.link(camera)
    # Blender's angle is that of the longer side.
    sides = sorted((scene.render.resolution_x, scene.render.resolution_y))
    angle = 2 * math.atan(math.tan(camera.data.angle / 2) * sides[0] / sides[1])
    radius = max((high - low).length / 2, 1e-9)
    distance = radius / math.sin(angle / 2)
    camera.rotation_euler = Euler(STARTUP_TURN)
    camera.location = (low + high) / 2 + Euler(STARTUP_TURN).to_matrix() @ Vector((0, 0, distance))
    camera.data.clip_start, camera.data.clip_end = distance / 1000, distance + 2 * radius
    scene.camera = camera
    # The grey of the viewport.
    scene.world = bpy.data.worlds.new("viewport")
    scene.world.color = (0.047, 0.047, 0.047)
    scene.view_settings.view_transform = "Standard"
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.display.shading.color_type = "MATERIAL"
    scene.render.filepath = picture
    bpy.ops.render.render(write_still=True)


main(*sys.argv[sys.argv.index("--") + 1 :])
