// A vertex of a source triangle (spec/blockfile.md 7.4).

in vec3 place;          // in finest voxels from the block's low corner
in vec4 tone;           // of the voxels around it
in ivec4 block;         // its low corner in finest voxels from the origin; level 0
in uvec2 draw;          // slot of its flag; list

out Corner {
    vec3 place;
    flat vec3 colour;
    flat uint slot;
} made;

void main()
{
    // One rounding of an exact sum: blocks that share the point get the same number.
    made.place = vec3(block.xyz) + place;
    made.colour = tone.rgb;
    made.slot = draw.x;
    gl_Position = clip * vec4(displaced(made.place), 1.0);
}
