export async function twinRoom(place) { place.append(document.createTextNode("twin")); }
