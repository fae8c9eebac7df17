// Numbers of no voxel.

layout(location = 0) out uvec2 number;

void main()
{
    number = uvec2(0u);
}
