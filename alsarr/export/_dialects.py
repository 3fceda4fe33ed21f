"""How the shading languages write the same few things."""

import re
from abc import ABC, abstractmethod
from collections.abc import Sequence


Parameters = Sequence[tuple[str, str]]
"""Type and name of each."""


class Dialect(ABC):
    """One shading language. Types are given in the words of HLSL and GLSL.

    - `first`: what must come before anything else, or nothing.
    - `frame`: what goes before a name of the uniform block.
    """

    first = ""
    frame = ""

    @abstractmethod
    def declarations(self, vectors: int) -> str:
        """Types and buffers; `vectors` of 4 numbers make a record."""

    @abstractmethod
    def constant(self, kind: str, name: str, value: str) -> str:
        """A number known when the shader is compiled."""

    @abstractmethod
    def let(self, kind: str, name: str, value: str) -> str:
        """A name for an intermediate value."""

    @abstractmethod
    def function(self, kind: str, name: str, parameters: Parameters) -> str:
        """The line that opens a function."""

    @abstractmethod
    def entry(self) -> str:
        """The lines that open the compute entry point, with the thread's `tile`."""

    @abstractmethod
    def loop(self, name: str, count: str) -> str:
        """The line that opens a loop from 0."""

    @abstractmethod
    def cast(self, kind: str, value: str) -> str:
        """A number as another kind of number."""


class _CLike(Dialect):
    const = "const"

    def constant(self, kind: str, name: str, value: str) -> str:
        return f"{self.const} {kind} {name} = {value};"

    def let(self, kind: str, name: str, value: str) -> str:
        return f"{kind} {name} = {value};"

    def function(self, kind: str, name: str, parameters: Parameters) -> str:
        listed = ", ".join(f"{k} {n}" for k, n in parameters)
        return f"{kind} {name}({listed}) {{"

    def loop(self, name: str, count: str) -> str:
        return f"for (uint {name} = 0u; {name} < {count}; ++{name}) {{"

    def cast(self, kind: str, value: str) -> str:
        return f"{kind}({value})"


class Hlsl(_CLike):
    const = "static const"

    def declarations(self, vectors: int) -> str:
        return f"""\
struct Record {{ float4 w[{vectors}]; }};

struct Tile {{
  uint texture_index;
  float mip_level;
  float velocity_x;
  float velocity_y;
  float luminance;
}};

StructuredBuffer<Record> records : register(t0);
StructuredBuffer<Tile> tiles : register(t1);
cbuffer Frame : register(b2) {{
  float refresh_rate;
  uint num_tiles;
}};
RWStructuredBuffer<float> qualities : register(u3);
"""

    def entry(self) -> str:
        return """\
[numthreads(64, 1, 1)]
void main(uint3 thread : SV_DispatchThreadID) {
  uint tile = thread.x;"""


class Glsl(_CLike):
    """GLSL, or with `es` that of OpenGL ES."""

    def __init__(self, version: str, precision: str = ""):
        self.first = f"#version {version}\n{precision}"

    def declarations(self, vectors: int) -> str:
        return f"""\
#ifdef VULKAN
#define AT(number) set = 0, binding = number
#else
#define AT(number) binding = number
#endif

layout(local_size_x = 64, local_size_y = 1, local_size_z = 1) in;

struct Record {{ vec4 w[{vectors}]; }};

struct Tile {{
  uint texture_index;
  float mip_level;
  float velocity_x;
  float velocity_y;
  float luminance;
}};

layout(std430, AT(0)) readonly buffer Records {{ Record records[]; }};
layout(std430, AT(1)) readonly buffer Tiles {{ Tile tiles[]; }};
layout(std140, AT(2)) uniform Frame {{
  float refresh_rate;
  uint num_tiles;
}};
layout(std430, AT(3)) buffer Qualities {{ float qualities[]; }};
"""

    def entry(self) -> str:
        return """\
void main() {
  uint tile = gl_GlobalInvocationID.x;"""


class Wgsl(Dialect):
    frame = "frame."

    def declarations(self, vectors: int) -> str:
        return f"""\
struct Record {{ w: array<vec4<f32>, {vectors}> }}

struct Tile {{
  texture_index: u32,
  mip_level: f32,
  velocity_x: f32,
  velocity_y: f32,
  luminance: f32,
}}

struct Frame {{
  refresh_rate: f32,
  num_tiles: u32,
}}

@group(0) @binding(0) var<storage, read> records: array<Record>;
@group(0) @binding(1) var<storage, read> tiles: array<Tile>;
@group(0) @binding(2) var<uniform> frame: Frame;
@group(0) @binding(3) var<storage, read_write> qualities: array<f32>;
"""

    def constant(self, kind: str, name: str, value: str) -> str:
        return f"const {name}: {_in_wgsl(kind)} = {value};"

    def let(self, kind: str, name: str, value: str) -> str:
        return f"let {name}: {_in_wgsl(kind)} = {value};"

    def function(self, kind: str, name: str, parameters: Parameters) -> str:
        listed = ", ".join(f"{n}: {_in_wgsl(k)}" for k, n in parameters)
        return f"fn {name}({listed}) -> {_in_wgsl(kind)} {{"

    def entry(self) -> str:
        return """\
@compute @workgroup_size(64, 1, 1)
fn main(@builtin(global_invocation_id) thread: vec3<u32>) {
  let tile: u32 = thread.x;"""

    def loop(self, name: str, count: str) -> str:
        return f"for (var {name}: u32 = 0u; {name} < {count}; {name} = {name} + 1u) {{"

    def cast(self, kind: str, value: str) -> str:
        return f"{_in_wgsl(kind)}({value})"


_WGSL = {"float": "f32", "uint": "u32"}


def _in_wgsl(kind: str) -> str:
    return _WGSL.get(kind, kind)


DIALECTS: dict[str, Dialect] = {
    "hlsl": Hlsl(),
    "glsl450": Glsl("450"),
    "glsl310es": Glsl("310 es", "precision highp float;\nprecision highp int;\n"),
    "wgsl": Wgsl(),
}


def commented(text: str) -> str:
    """Lines of a comment; nothing in `text` can end it."""
    plain = text.encode("ascii", "replace").decode().replace("\\", "/")
    lines = [re.sub(r"[^ -~]", " ", line).rstrip() for line in plain.splitlines()]
    return "\n".join(f"// {line}".rstrip() for line in lines)
