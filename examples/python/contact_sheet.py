"""The first pictures of many models side by side: python contact_sheet.py MODEL|FOLDER... [-o sheet.png]

Each model is rendered as a new user would: without any option but the size. Where f3d is installed (and xvfb-run, on
machines without a screen) its first view stands beside it, and that of Blender. Needs Pillow.
"""

import argparse
import math
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image, ImageDraw

ENDINGS = {".obj", ".ply", ".stl", ".off", ".3mf", ".nff", ".gltf", ".glb", ".toml"}
LINE = 16  # pixels of a line of text


def models_of(places):
    """The models that are named, and those in folders that are."""
    for place in map(Path, places):
        found = sorted(place.rglob("*")) if place.is_dir() else [place]
        yield from (path for path in found if path.suffix.lower() in ENDINGS)


def by_raybrook(program):
    def render(model, picture, size):
        return [*program, "render", str(model), "-q", "--size", f"{size[0]}x{size[1]}", "-o", str(picture)]

    return render


def screen():
    return ["xvfb-run", "-a"] if shutil.which("xvfb-run") else []


def by_f3d():
    def render(model, picture, size):
        return [*screen(), "f3d", str(model), f"--output={picture}", f"--resolution={size[0]},{size[1]}"]

    return render


def by_blender():
    command = ["blender", "-b", "--factory-startup", "-P", str(Path(__file__).with_name("blender_view.py")), "--"]

    def render(model, picture, size):
        return [*screen(), *command, str(model.resolve()), str(picture), f"{size[0]}x{size[1]}"]

    return render


def picture_of(render, model, size, folder):
    """What a program makes of a model; a grey card with its last words where that is no picture."""
    file = folder / "picture.png"
    file.unlink(missing_ok=True)
    done = subprocess.run(render(model, file, size), capture_output=True, text=True, errors="replace")
    if file.exists():
        return Image.open(file).convert("RGB").resize(size)
    card = Image.new("RGB", size, (90, 90, 90))
    ImageDraw.Draw(card).multiline_text((8, 8), "\n".join((done.stderr or done.stdout).splitlines()[-3:])[:300])
    return card


def sheet_of(models, programs, size, columns):
    """A cell for each model: its name, and below it the picture of each program."""
    width, height = size[0] * len(programs), size[1] + LINE
    rows = math.ceil(len(models) / columns)
    sheet = Image.new("RGB", (width * columns, height * rows), "white")
    with tempfile.TemporaryDirectory() as folder:
        for number, model in enumerate(models):
            left, top = number % columns * width, number // columns * height
            ImageDraw.Draw(sheet).text((left + 4, top + 2), model.name, fill="black")
            for place, render in enumerate(programs):
                picture = picture_of(render, model, size, Path(folder))
                sheet.paste(picture, (left + place * size[0], top + LINE))
            print(model, file=sys.stderr)
    return sheet


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("places", nargs="+", metavar="MODEL|FOLDER")
    parser.add_argument("-o", "--output", default="sheet.png")
    parser.add_argument(
        "--raybrook", action="append", metavar="PROGRAM", help="may be given again, to compare versions"
    )
    parser.add_argument("--no-f3d", action="store_true", help="without f3d, though it is installed")
    parser.add_argument("--no-blender", action="store_true", help="without Blender, though it is installed")
    parser.add_argument("--size", default="320x240", metavar="WxH", help="of each picture")
    parser.add_argument("--columns", type=int, default=4)
    arguments = parser.parse_args()
    size = tuple(map(int, arguments.size.split("x")))
    programs = [by_raybrook(program.split()) for program in arguments.raybrook or ["raybrook"]]
    if shutil.which("f3d") and not arguments.no_f3d:
        programs.append(by_f3d())
    if shutil.which("blender") and not arguments.no_blender:
        programs.append(by_blender())
    models = list(models_of(arguments.places))
    if not models:
        parser.error("there are no models")
    sheet_of(models, programs, size, arguments.columns).save(arguments.output, optimize=True)


if __name__ == "__main__":
    main()
