// SRAA, second half (thesis, 4.10): each sample of a pixel takes the colour that was shaded for its
// voxel, in this pixel or one beside it; else for the voxel next to its own; never nothing.

uniform usampler2DMS numbers;
uniform sampler2D shaded;
uniform vec3 background;

layout(std430, binding = 1) readonly buffer Records { int records[]; };
layout(std430, binding = 2) readonly buffer Pool { uint words[]; };

layout(location = 0) out vec4 pixel;

// The voxel's middle in finest voxels.
vec3 middle(uvec2 number)
{
    uint voxel = words[(number.x - 1u) * STRIDE], record = number.y * 6u;
    float edge = float(1 << records[record + 3u]);
    vec3 corner = vec3(records[record], records[record + 1u], records[record + 2u]);
    return corner + edge * (vec3(voxel & 255u, voxel >> 8 & 255u, voxel >> 16 & 255u) + 0.5);
}

void main()
{
    ivec2 here = ivec2(gl_FragCoord.xy), most = textureSize(numbers) - 1;
    vec3 sum = vec3(0.0);
    float covered = 0.0;
    for (int i = 0; i < SRAA; i++) {
        uvec2 number = texelFetch(numbers, here, i).xy;
        if (number.x == 0u) {
            sum += decoded(background);
            continue;
        }
        covered += 1.0;
        vec3 colour = vec3(0.0);
        float best = 1e30;
        for (int j = 0; j < 9 && best > 0.0; j++) {
            // The pixel itself first, then its neighbours.
            int k = (j + 4) % 9;
            ivec2 at = clamp(here + ivec2(k % 3, k / 3) - 1, ivec2(0), most);
            uvec2 other = texelFetch(numbers, at, 0).xy;
            if (other.x == 0u) continue;
            float apart = other == number ? 0.0 : 1e-6 + distance(middle(other), middle(number));
            if (apart >= best) continue;
            best = apart;
            colour = texelFetch(shaded, at, 0).rgb;
        }
        sum += decoded(best < 1e30 ? colour : background);
    }
    pixel = vec4(encoded(sum / float(SRAA)), covered / float(SRAA));
}
